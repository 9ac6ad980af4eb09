// Takes: what was performed, kept by the studio. Every page sees the same list; comparing draws a
// take beside what is performed now, in the viewport, in the curves and over the error strip.

import { useSignal } from "@preact/signals";
import { Circle, CircleDot, Diamond, GitCompare, Pin, Table2, X } from "lucide";
import { Icon } from "./icon";
import { labelInWords } from "./policy_words";
import type { TakeCard, TakesView } from "./protocol";
import * as store from "./store";
import { takeColor } from "./theme";
import { Thumbnail } from "./thumbnail";
import { complain, http, tell } from "./wire";

let told = false;

/** What the studio says of its takes; the motions that are drawn are fetched once. */
export function heardOfTakes(view: TakesView): void {
  if (!told) for (const sentence of view.skipped) store.toast(sentence, "error");
  told = true;
  store.takes.value = view.takes;
  store.compared.value = view.compared;
  const wanted = new Map([...store.performedTakes.value].filter(([id]) => view.compared.includes(id)));
  if (wanted.size !== store.performedTakes.value.size) store.performedTakes.value = wanted;
  for (const id of view.compared) if (!wanted.has(id)) void load(id);
}

async function load(id: number): Promise<void> {
  try {
    const frames = await http("GET /api/takes/{id}", { at: { id } });
    if (store.compared.value.includes(id))
      store.performedTakes.value = new Map(store.performedTakes.value).set(id, frames);
  } catch (e) {
    complain(e);
  }
}

/** The take that the rollout on the page is, once it is done. */
export function takeOfNow(): TakeCard | undefined {
  const r = store.rollout.value;
  return r?.phase === "done"
    ? store.takes.value.find((t) => t.rev === r.rev && t.same_goals && t.policy === r.policy)
    : undefined;
}

export function pinTake(): void {
  const now = takeOfNow();
  if (!now) return store.toast("the rollout has not finished yet");
  tell("take.pin", { id: now.id, pinned: !now.pinned });
  store.toast(now.pinned ? `${now.name} is no longer pinned` : `${now.name} is pinned`);
}

/** Alone, or added to those that are drawn already. */
export function toggleCompared(id: number, add: boolean): void {
  const on = store.compared.value;
  const ids = on.includes(id) ? on.filter((c) => c !== id) : add ? [...on, id] : [id];
  tell("take.compare", { ids });
}

/** The newest take that is not the one of now, or none any more. */
export function compareBefore(): void {
  if (store.compared.value.length) return tell("take.compare", { ids: [] });
  const now = takeOfNow();
  const other =
    store.takes.value.find((t) => t.pinned && t.id !== now?.id) ??
    store.takes.value.find((t) => t.id !== now?.id);
  if (!other) return store.toast("there is no other take yet: edit the clip, or select another policy");
  tell("take.compare", { ids: [other.id] });
  store.toast(`compared with ${other.name}, ${other.policy}`);
}

function Row({ take }: { take: TakeCard }) {
  /** The name as it is being typed. */
  const text = useSignal<string | undefined>(undefined);
  const now = takeOfNow()?.id === take.id;
  const on = store.compared.value.indexOf(take.id);
  const done = (): void => {
    const name = text.value?.trim();
    text.value = undefined;
    if (name && name !== take.name) tell("take.name", { id: take.id, name });
  };
  const about = `${take.policy}, ${take.frames} frames${take.seed ? `, seed ${take.seed}` : ""}${take.clip ? `, of "${take.clip}"` : ""}${take.same_goals ? "" : "; it was measured against other goals, so its error cannot be compared"}`;
  return (
    <li class={`take${take.same_goals ? "" : " stale"}`} title={about} data-testid={`take-${take.id}`}>
      <span
        class="mark"
        role="img"
        style={on >= 0 ? `color: ${takeColor(on)}` : ""}
        aria-label={now ? "current" : on >= 0 ? "compared" : "kept"}
      >
        <Icon of={now ? CircleDot : on >= 0 ? Diamond : Circle} size={12} />
      </span>
      {text.value !== undefined ? (
        <input
          type="text"
          class="grow"
          aria-label={`Name of ${take.name}`}
          value={text.value}
          onInput={(e) => (text.value = e.currentTarget.value)}
          ref={(e) => {
            if (e && document.activeElement !== e) {
              e.focus();
              e.select();
            }
          }}
          onBlur={done}
          onKeyDown={(e) => {
            e.stopPropagation();
            if (e.key === "Enter") e.currentTarget.blur();
            if (e.key === "Escape") text.value = undefined;
          }}
        />
      ) : (
        <button
          class="quiet grow"
          aria-label={`Rename ${take.name}`}
          title={`${about}. Click to rename`}
          onClick={() => (text.value = take.name)}
        >
          {take.name}
        </button>
      )}
      <span class="num">{take.mae === null ? "" : store.shownError(take.mae, store.unit.value)}</span>
      <span class="second">
        <Thumbnail of={{ take: take.id }} />
        <span class="grow">{labelInWords(take.policy)}</span>
        <span class="hands">
          <button
            class="quiet small"
            aria-label={`A/B ${take.name}`}
            aria-pressed={on >= 0}
            onClick={(e) => toggleCompared(take.id, e.ctrlKey || e.metaKey || e.shiftKey)}
            title="Compare it with the current take (B); Ctrl adds it to the comparison"
          >
            A/B
          </button>
          <button
            class="icon quiet"
            aria-label={`Pin ${take.name}`}
            aria-pressed={take.pinned}
            title={
              take.pinned
                ? "Pinned; click to unpin"
                : "Pin it: a take that is not pinned is removed once there are twenty newer ones"
            }
            onClick={() => tell("take.pin", { id: take.id, pinned: !take.pinned })}
          >
            <Icon of={Pin} size={13} />
          </button>
          <button
            class="icon quiet"
            aria-label={`Remove ${take.name}`}
            title="Remove"
            onClick={() => tell("take.remove", { id: take.id })}
          >
            <Icon of={X} size={13} />
          </button>
        </span>
      </span>
    </li>
  );
}

export function TakeList() {
  const r = store.rollout.value;
  const takes = store.takes.value;
  const now = takeOfNow();
  // Those that somebody wanted stand first.
  const sorted = [...takes.filter((t) => t.pinned), ...takes.filter((t) => !t.pinned)];
  return (
    <section class="panel fill" aria-label="Takes" data-testid="takes">
      <div class="tools-row">
        <button
          onClick={pinTake}
          disabled={!now}
          aria-pressed={now?.pinned ?? false}
          title="Keep the current take until it is removed (Shift+B)"
          data-testid="pin"
        >
          <Icon of={Pin} size={13} /> Pin
        </button>
        <button
          onClick={compareBefore}
          aria-pressed={store.compared.value.length > 0}
          title="Draw another take beside the current one (B)"
        >
          <Icon of={GitCompare} size={13} /> A/B
        </button>
        <button
          onClick={() => (store.side.value = "compare")}
          aria-pressed={store.side.value === "compare"}
          title="Error, worst joint and roughness of all takes"
        >
          <Icon of={Table2} size={13} /> Table
        </button>
      </div>
      <div class="scroll takes">
        {r && !now ? (
          <div class="take">
            <b class="grow" title={r.policy}>
              current · {r.policy}
            </b>
            <span class="num">{r.mae === null ? "…" : store.shownError(r.mae, store.unit.value)}</span>
          </div>
        ) : null}
        {store.compared.value.length ? (
          <button
            class="quiet"
            style="width: 100%"
            title="Stop comparing (B)"
            onClick={() => tell("take.compare", { ids: [] })}
          >
            Stop comparing
          </button>
        ) : null}
        <ul aria-label="Takes kept">
          {sorted.map((t) => (
            <Row key={t.id} take={t} />
          ))}
        </ul>
      </div>
    </section>
  );
}
