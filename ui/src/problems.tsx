// What is wrong with the clip, and what mends it.

import { CircleCheck, CircleX, Footprints, Info, TriangleAlert } from "lucide";
import { seek } from "./actions/playback";
import { clock } from "./clip";
import { Icon } from "./icon";
import { inUnits } from "./numbers";
import * as store from "./store";
import { applyOp } from "./wire";

const SIGNS = { error: CircleX, warning: TriangleAlert, info: Info };

/** A clip that was only begun has no problems yet: it asks for its second key. */
export const begun = (): boolean => (store.doc.value?.clip.keys.length ?? 0) < 2;

export function Problems() {
  const all = store.doc.value?.findings.lints ?? [];
  const lints = begun() ? all.filter((l) => l.rule !== "blind-span") : all;
  const problems = lints.filter((l) => l.level !== "info").length;
  const hints = lints.length - problems;
  const title = problems
    ? `Problems (${problems})`
    : begun()
      ? "Next step"
      : `No problems${hints ? `, hints (${hints})` : ""}`;
  return (
    <section class="panel problems" aria-label="Problems" data-testid="problems">
      <h2 class={problems || begun() ? "" : "well"}>
        <Icon of={problems ? TriangleAlert : begun() ? Footprints : CircleCheck} size={14} />
        {title}
      </h2>
      {begun() ? (
        <p class="next" data-testid="next-step">
          Add a second key: click a later time on the timeline, then move a joint or choose a pose.
        </p>
      ) : null}
      <div class="scroll">
        {lints.map((l, i) => (
          <div class={`problem ${l.level}`} key={`${l.rule}${i}`}>
            <span class="mark" role="img" aria-label={l.level}>
              <Icon of={SIGNS[l.level]} size={14} />
            </span>
            <div>
              <p>
                {l.frames ? (
                  <button class="quiet at" onClick={() => seek(l.frames?.[0] ?? 0)}>
                    {clock(l.frames[0], store.fps.value)}
                  </button>
                ) : null}
                {inUnits(l.message, store.degrees.value)}
              </p>
              {l.mends.length ? (
                <div class="mends">
                  {l.mends.map((m) => (
                    <button key={m.title} onClick={() => void applyOp(m.op)}>
                      {m.title}
                    </button>
                  ))}
                </div>
              ) : null}
            </div>
          </div>
        ))}
      </div>
    </section>
  );
}
