// Joint sliders: the pose at the playhead, with limits, error and coupled joints.

import { useSignal } from "@preact/signals";
import { act } from "./actions/index";
import { keyAt } from "./clip";
import { isLocked } from "./locks";
import { ANGLES, fixed, LENGTHS, parseNumber } from "./numbers";
import { jointMoved, poseAt } from "./posing";
import { Reach } from "./reach";
import * as store from "./store";
import { complain, http, tell } from "./wire";

/** All joints that move with this one, with their values when it is at `value`. */
function together(name: string, value: number): Record<string, number> {
  const changes: Record<string, number> = { [name]: value };
  for (const c of store.doc.value?.table.couplings ?? []) {
    const members = c.members ?? [];
    const own = members.find((m) => m.joint === name);
    if (!own) continue;
    const shared = (value - (own.offset ?? 0)) / (own.coef || 1);
    for (const m of members) changes[m.joint] = (m.coef ?? 1) * shared + (m.offset ?? 0);
  }
  return changes;
}

function Padlock() {
  return (
    <svg width="9" height="11" viewBox="0 0 9 11" aria-label="locked">
      <path d="M1 5h7v6H1z M2.5 5V3.2a2 2 0 0 1 4 0V5" fill="none" stroke="currentColor" stroke-width="1.4" />
    </svg>
  );
}

/** A joint may stand in several groups; `again` tells its later controls apart. */
function Joint({ index, again = "" }: { index: number; again?: string }) {
  const d = store.doc.value;
  const text = useSignal<string | undefined>(undefined);
  const live = useSignal<number | undefined>(undefined);
  const held = useSignal<number | undefined>(undefined);
  const fact = d?.table.joints[index];
  if (!d || !fact) return null;
  const frame = store.playhead.value;
  const pose = store.floating.value ?? poseAt(d.clip, frame);
  const value = live.value ?? store.moving.value?.[fact.name] ?? pose[index] ?? 0;
  const unit = fact.unit;
  const scale = unit === "rad" && store.degrees.value ? 180 / Math.PI : 1;
  // A joint without stops has a slider about its value, which stands still while it is dragged.
  const reach = unit === "m" ? 1 : Math.PI;
  const middle = held.value ?? Math.round(value / reach) * reach;
  const [lo, hi] = fact.range ?? [middle - reach, middle + reach];
  const achieved = store.frames.value.q[frame]?.[index];
  const commanded = keyAt(d.clip, frame) !== undefined;
  const off = achieved === undefined || !commanded ? undefined : Math.abs(achieved - value);
  const name = fact.name;
  const title = store.titles.value[index] ?? name;
  const coupled = Object.keys(together(name, 0)).filter((n) => n !== name);
  const set = (v: number, done: boolean): void => {
    if (!Number.isFinite(v)) return;
    const inside = fact.range ? Math.min(fact.range[1], Math.max(fact.range[0], v)) : v;
    live.value = done ? undefined : inside;
    void jointMoved(together(name, inside), done);
  };
  const typed = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const inner = parseNumber(t, unit === "rad" ? ANGLES : LENGTHS, 1 / scale);
    if (inner === undefined)
      return store.toast(
        `"${t}" is not a number of ${unit === "m" ? "metres" : store.degrees.value ? "degrees" : "radians"}`,
        "error",
      );
    if (fact.range && (inner < fact.range[0] || inner > fact.range[1])) {
      store.toast(
        `${title} goes from ${store.shown(fact.range[0], unit)} to ${store.shown(fact.range[1], unit)}`,
      );
    }
    set(inner, true);
  };
  const id = `joint-${index}${again && `-${again}`}`;
  const locked = isLocked(name);
  // Where the data of the robot's policy are, as a tint behind the slider.
  const share = (v: number): number => Math.min(1, Math.max(0, (v - lo) / (hi - lo)));
  const band = fact.band ? { from: share(fact.band[0]), to: share(fact.band[1]) } : undefined;
  const usual = fact.band
    ? `; 98 % of the policy's training data lie within ${store.shown(fact.band[0], unit)} to ${store.shown(fact.band[1], unit)}`
    : "";
  return (
    <div
      class={`joint ${store.joint.value === index ? "on" : ""} ${locked ? "locked" : ""}`}
      data-testid={id}
    >
      <label
        for={id}
        title={`${name}${coupled.length ? `; moves with ${coupled.join(", ")}` : ""}${usual}`}
        onClick={() => select(index)}
      >
        {title}
        {coupled.length ? (
          <span aria-hidden="true" style="color: var(--marker)">
            {" "}
            &
          </span>
        ) : null}
        {locked ? (
          <span class="lock" title="Locked; Alt+L unlocks it">
            <Padlock />
          </span>
        ) : null}
      </label>
      <span class="slider">
        {band ? (
          <i
            class="band"
            style={`left: calc(8px + ${band.from} * (100% - 16px)); width: calc(${band.to - band.from} * (100% - 16px))`}
          />
        ) : null}
        <input
          id={id}
          type="range"
          disabled={locked}
          data-band={band ? `${band.from.toFixed(3)} ${band.to.toFixed(3)}` : undefined}
          min={lo}
          max={hi}
          step={(hi - lo) / 2000}
          value={value}
          aria-valuetext={store.shown(value, unit)}
          onFocus={() => select(index)}
          onPointerDown={() => (held.value = middle)}
          onPointerUp={() => (held.value = undefined)}
          onPointerCancel={() => (held.value = undefined)}
          onInput={(e) => set(Number(e.currentTarget.value), false)}
          onChange={(e) => set(Number(e.currentTarget.value), true)}
        />
      </span>
      <input
        type="text"
        disabled={locked}
        aria-label={`${title}, value`}
        inputMode="decimal"
        value={text.value ?? fixed(value * scale, unit === "m" ? 3 : store.degrees.value ? 1 : 3)}
        onInput={(e) => (text.value = e.currentTarget.value)}
        onBlur={typed}
        onKeyDown={(e) => {
          if (e.key === "Enter") typed();
          if (e.key === "Escape") text.value = undefined;
          if (e.key === "ArrowUp" || e.key === "ArrowDown") {
            const step =
              (e.shiftKey ? 0.1 : 1) * (unit === "m" ? 0.01 : Math.PI / 180) * (e.key === "ArrowUp" ? 1 : -1);
            set(value + step, true);
            e.preventDefault();
          }
        }}
      />
      {off !== undefined && off > 0.002 ? (
        <span class="err">
          reached {store.shown(achieved ?? 0, unit)}, off by {store.shownError(off, unit)}
        </span>
      ) : null}
    </div>
  );
}

function select(index: number): void {
  if (store.joint.value === index) return;
  store.joint.value = index;
  const name = store.doc.value?.clip.robot.joints[index];
  if (name) tell("view.select", { joint: name });
}

async function settle(): Promise<void> {
  const d = store.doc.value;
  if (!d) return;
  try {
    const answer = await http("POST /api/settle", { body: { q: poseAt(d.clip, store.playhead.value) } });
    const changes = Object.fromEntries(
      d.clip.robot.joints.flatMap((n, j) => (isLocked(n) ? [] : [[n, answer.q[j] ?? 0]])),
    );
    const worst = Math.max(0, ...answer.residual.map(Math.abs));
    void jointMoved(changes, true);
    store.toast(
      `settled: the simulated robot ends within ${store.shownError(worst, store.unit.value)} of the pose`,
    );
  } catch (e) {
    complain(e);
  }
}

export function Inspector() {
  const d = store.doc.value;
  if (!d) return null;
  const frame = store.playhead.value;
  const key = keyAt(d.clip, frame);
  const grouped = new Set(store.groups.value.flatMap((g) => g.joints));
  const rest = d.clip.robot.joints.map((_, j) => j).filter((j) => !grouped.has(j));
  return (
    <section class="panel fill" aria-label="Inspector" data-testid="inspector">
      <h2>
        {key ? `Key at ${frame}` : `Frame ${frame}`}
        {key?.pose ? ` · ${key.pose}` : ""}
        <span class="grow" />
        {store.unit.value === "rad" ? (
          <button class="quiet" onClick={() => act("unit")} aria-label="Switch between degrees and radians">
            {store.degrees.value ? "deg" : "rad"}
          </button>
        ) : null}
      </h2>
      <Reach />
      <div class="scroll">
        {rest.map((j) => (
          <Joint key={j} index={j} />
        ))}
        {store.groups.value.map((g) => (
          <details class="group" key={g.name} open={!store.closed.value.has(g.name)}>
            <summary>{g.title}</summary>
            {g.joints.map((j) => (
              <Joint
                key={j}
                index={j}
                again={store.groups.value.find((first) => first.joints.includes(j)) === g ? "" : g.name}
              />
            ))}
          </details>
        ))}
      </div>
      <div class="tools-row">
        <button onClick={() => act("key")} disabled={!!key && !store.floating.value} title="K">
          Key
        </button>
        <button
          onClick={() => void settle()}
          title="Simulate holding this pose and keep the pose that the robot reaches"
        >
          Settle
        </button>
        <button
          onClick={() => act("mirror")}
          disabled={store.noMirror.value !== null || store.selection.value.size === 0}
          title={store.noMirror.value ?? "Mirror the selected keys"}
        >
          Mirror
        </button>
        <button onClick={() => act("save-pose")} title="P">
          Save pose
        </button>
      </div>
    </section>
  );
}
