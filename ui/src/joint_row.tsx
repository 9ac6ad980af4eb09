// One joint: its name, a field that is its slider, its value. In the field: the level as a tint,
// where the data of the policy lie as another, what was reached as a line.

import { useSignal } from "@preact/signals";
import { Link2, Lock } from "lucide";
import { useRef } from "preact/hooks";
import { keyAt, values } from "./clip";
import { together } from "./couplings";
import { hold } from "./hand";
import { Icon } from "./icon";
import { rightShown } from "./layout";
import { isLocked } from "./locks";
import { ANGLES, fixed, LENGTHS, parseNumber } from "./numbers";
import { jointMoved, valueAt } from "./posing";
import * as store from "./store";
import { tell } from "./wire";

/** A joint may stand in several groups; `again` tells its later controls apart. */
export function Joint({ index, again = "" }: { index: number; again?: string }) {
  const d = store.doc.value;
  const text = useSignal<string | undefined>(undefined);
  const live = useSignal<number | undefined>(undefined);
  const room = useRef<{ opened: number; top: number } | undefined>(undefined);
  const drag = useRef<{ x: number; at: number; moved: boolean } | undefined>(undefined);
  const fact = d?.table.joints[index];
  if (!d || !fact) return null;
  const frame = store.playhead.value;
  const pose = store.floating.value?.[index] ?? valueAt(d.clip, index, frame);
  const value = live.value ?? store.moving.value?.[fact.name] ?? pose;
  const unit = fact.unit;
  const scale = unit === "rad" && store.degrees.value ? 180 / Math.PI : 1;
  // A joint without stops has a slider about 0 that has room for all keys. It grows, but not under a hand.
  const reach = unit === "m" ? 1 : Math.PI;
  if (!fact.range && !drag.current) {
    const own = d.clip.keys.map((k) => Math.abs(values(d.clip, k)[index] ?? 0));
    const most = (Math.floor(Math.max(Math.abs(value), ...own) / reach) + 1) * reach;
    const before = room.current?.opened === d.opened ? room.current.top : 0;
    room.current = { opened: d.opened, top: Math.max(most, before) };
  }
  const top = room.current?.top ?? reach;
  const [lo, hi] = fact.range ?? [-top, top];
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
  // A press chooses the joint, a drag turns it by as much as the hand goes; nothing jumps.
  const grab = (e: PointerEvent): void => {
    const field = e.currentTarget as HTMLElement;
    if (locked || e.button !== 0) return;
    e.preventDefault();
    field.querySelector("input")?.focus();
    field.setPointerCapture(e.pointerId);
    drag.current = { x: e.clientX, at: value, moved: false };
    hold(() => letGo(undefined, false));
  };
  const pull = (e: PointerEvent): void => {
    const d = drag.current;
    if (!d || (!d.moved && Math.abs(e.clientX - d.x) < 3)) return;
    d.moved = true;
    const wide = (e.currentTarget as HTMLElement).clientWidth;
    const to = d.at + ((e.clientX - d.x) / wide) * (hi - lo) * (e.shiftKey ? 0.1 : 1);
    d.at = fact.range ? Math.min(hi, Math.max(lo, to)) : to;
    d.x = e.clientX;
    set(d.at, false);
  };
  const letGo = (e: Event | undefined, keep: boolean): void => {
    const d = drag.current;
    drag.current = undefined;
    if (!d?.moved) return;
    e?.stopPropagation();
    if (keep) return set(d.at, true);
    live.value = undefined;
    void jointMoved({}, true);
  };
  const typed = (): void => {
    const t = text.value;
    text.value = undefined;
    if (t === undefined) return;
    const inner = parseNumber(t, unit === "rad" ? ANGLES : LENGTHS, 1 / scale, value);
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
  const share = (v: number): number => Math.min(1, Math.max(0, (v - lo) / (hi - lo)));
  // Where the data of the robot's policy are, as a tint in the field.
  const band = fact.band ? { from: share(fact.band[0]), to: share(fact.band[1]) } : undefined;
  const usual = fact.band
    ? `; 98 % of the policy's training data lie within ${store.shown(fact.band[0], unit)} to ${store.shown(fact.band[1], unit)}`
    : "";
  const chosen = store.joint.value === index;
  const missed = off !== undefined && off > 0.002;
  const reached = `reached ${store.shown(achieved ?? 0, unit)}, off by ${store.shownError(off ?? 0, unit)}`;
  const about = `${name}${coupled.length ? `; moves with ${coupled.join(", ")}` : ""}${missed ? `; ${reached}` : ""}${usual}`;
  return (
    <div class={`joint ${chosen ? "on" : ""} ${locked ? "locked" : ""}`} data-testid={id}>
      <label for={id}>
        <span>{title}</span>
        {coupled.length ? <Icon of={Link2} size={11} /> : null}
        {locked ? (
          <span class="lock" title="Locked; Alt+L unlocks it">
            <Icon of={Lock} size={11} />
          </span>
        ) : null}
      </label>
      <span
        class="slider"
        title={about}
        onPointerDown={grab}
        onPointerMove={pull}
        onPointerUp={(e) => letGo(e, true)}
        onPointerCancel={(e) => letGo(e, false)}
        onDblClick={() => !locked && toJoint(index)}
      >
        {band ? <i class="band" style={`left: ${100 * band.from}%; right: ${100 * (1 - band.to)}%`} /> : null}
        <i class="level" style={`right: ${100 * (1 - share(value))}%`} />
        {missed ? <i class="reached" style={`left: ${100 * share(achieved ?? 0)}%`} /> : null}
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
          onInput={(e) => set(Number(e.currentTarget.value), false)}
          onChange={(e) => set(Number(e.currentTarget.value), true)}
        />
      </span>
      <input
        type="text"
        disabled={locked}
        aria-label={`${title}, value`}
        inputMode="decimal"
        title="Sums are allowed: 10+5; +=5 and *=2 change the value"
        value={text.value ?? fixed(value * scale, unit === "m" ? 3 : store.degrees.value ? 1 : 3)}
        onInput={(e) => (text.value = e.currentTarget.value)}
        onBlur={typed}
        onKeyDown={(e) => {
          // Escape drops what was typed. Either way the keys are the page's again.
          if (e.key === "Escape") text.value = undefined;
          if (e.key === "Enter" || e.key === "Escape") e.currentTarget.blur();
          if (e.key === "ArrowUp" || e.key === "ArrowDown") {
            const step =
              (e.shiftKey ? 0.1 : 1) * (unit === "m" ? 0.01 : Math.PI / 180) * (e.key === "ArrowUp" ? 1 : -1);
            set(value + step, true);
            e.preventDefault();
          }
        }}
      />
      {missed && chosen ? <span class="err">{reached}</span> : null}
    </div>
  );
}

function select(index: number): void {
  if (store.joint.value === index) return;
  store.joint.value = index;
  const name = store.doc.value?.clip.robot.joints[index];
  if (name) tell("view.select", { joint: name });
}

/** Chooses a joint and puts the typing mark into its field. */
export function toJoint(index: number): void {
  rightShown.value = true;
  select(index);
  requestAnimationFrame(() => {
    const field = document.querySelector<HTMLInputElement>(`[data-testid=joint-${index}] input[type=text]`);
    field?.scrollIntoView({ block: "nearest" });
    field?.select();
    field?.focus();
  });
}
