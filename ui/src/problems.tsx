// What is wrong with the clip, and what mends it.

import { ChevronRight, CircleCheck, CircleX, Footprints, Info, TriangleAlert } from "lucide";
import { seek } from "./actions/playback";
import { clock } from "./clip";
import { Icon } from "./icon";
import { fixAll, type Kind, kindsOf } from "./kinds";
import { inUnits } from "./numbers";
import type { Lint } from "./protocol";
import * as store from "./store";
import { applyOp } from "./wire";

const SIGNS = { error: CircleX, warning: TriangleAlert, info: Info };

/** Problems of one kind that fold into one line when there are so many in all. */
const FOLDED = 4;
const MANY = 24;
/** Problems of one kind that are listed one by one. */
const LISTED = 200;

/** A clip that was only begun has no problems yet: it asks for its second key. */
export const begun = (): boolean => (store.doc.value?.clip.keys.length ?? 0) < 2;

async function mendAll(kind: Kind): Promise<void> {
  const op = fixAll(kind);
  if (op && (await applyOp(op))) store.toast(`${kind.title}: ${kind.fixable} problems`, "info", true);
}

function FixAll({ kind }: { kind: Kind }) {
  if (kind.fixable < 2) return null;
  return (
    <button
      title={`${kind.title}: all ${kind.fixable} of this kind, as one edit`}
      onClick={(e) => {
        // In the heading of a group a click would unfold it, too.
        e.preventDefault();
        void mendAll(kind);
      }}
      data-testid="fix-all"
    >
      Fix all {kind.fixable}
    </button>
  );
}

function Problem({ of: l, kind }: { of: Lint; kind?: Kind | undefined }) {
  return (
    <div class={`problem ${l.level}`}>
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
            {kind ? <FixAll kind={kind} /> : null}
          </div>
        ) : null}
      </div>
    </div>
  );
}

/** Problems of one kind in one line, which unfolds. */
function Folded({ kind }: { kind: Kind }) {
  const { level, rule } = kind;
  return (
    <details class={`problem-kind ${level}`}>
      <summary>
        <Icon of={ChevronRight} size={14} />
        <span class="mark" role="img" aria-label={level}>
          <Icon of={SIGNS[level]} size={14} />
        </span>
        <span class="grow">
          <b>{kind.lints.length}</b> × {rule.replaceAll("-", " ")}
        </span>
        <FixAll kind={kind} />
      </summary>
      {kind.lints.slice(0, LISTED).map((l, i) => (
        <Problem key={i} of={l} />
      ))}
      {kind.lints.length > LISTED ? <p class="next">and {kind.lints.length - LISTED} more</p> : null}
    </details>
  );
}

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
        {kindsOf(lints).map((kind) =>
          lints.length > MANY && kind.lints.length >= FOLDED ? (
            <Folded key={kind.name} kind={kind} />
          ) : (
            kind.lints.map((l, i) => (
              <Problem key={`${kind.name}${i}`} of={l} kind={i === 0 ? kind : undefined} />
            ))
          ),
        )}
      </div>
    </section>
  );
}
