// The line at the bottom: what keys and the mouse do now, and whether all is saved.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { span } from "./actions/masks";
import { overLink } from "./hover";
import type { Demand as DemandOf } from "./protocol";
import * as store from "./store";

/** While the pointer is over a link. */
const LINK_HINTS: [string, string][] = [
  ["drag", "turn its joint"],
  ["Alt", "reach"],
  ["Shift", "small steps"],
  ["Esc", "cancel"],
  ["click", "select"],
  ["F", "show it"],
  ["G", "next fingertip"],
  ["?", "all shortcuts"],
];
/** What keys and the mouse do now; M says which frames it means. */
function hints(): [string, string][] {
  const s = span();
  const mask = s ? `mask ${s.to - s.from === 1 ? s.from : `${s.from} to ${s.to - 1}`} (${s.why})` : "mask";
  return [
    ["drag", "move"],
    ["Alt", "copy"],
    ["Shift", "move later keys too"],
    ["S", "retime"],
    ["K", "key"],
    ["Space", "play"],
    ["?", "all shortcuts"],
    ["M", mask],
  ];
}

/** What the edit under the hand asks of the joints: red above what the policy's data hold. */
function Demand({ of }: { of: DemandOf }) {
  const index = store.doc.value?.clip.robot.joints.indexOf(of.joint) ?? -1;
  const limit = Math.min(of.usual ?? Infinity, of.max ?? Infinity);
  const above = of.needed > limit;
  const unit = of.unit === "m" ? "m/s" : store.degrees.value ? "°/s" : "rad/s";
  const speed = (v: number): string =>
    of.unit === "rad" && store.degrees.value ? ((v * 180) / Math.PI).toFixed(0) : v.toFixed(2);
  const what =
    of.max !== null && of.needed > of.max
      ? `the limit of the joint is ${speed(of.max)}`
      : `the policy was trained up to ${speed(of.usual ?? of.max ?? 0)}`;
  return (
    <b class={`demand ${above ? "above" : ""}`} data-testid="demand">
      {above ? "too fast: " : ""}
      {store.titles.value[index] ?? of.joint} needs {speed(of.needed)} {unit}, {what}
    </b>
  );
}

export function Hint({ text }: { text: string }) {
  const held = useSignal("");
  useEffect(() => {
    const on = (e: KeyboardEvent): void => {
      held.value = [
        e.ctrlKey || e.metaKey ? "Ctrl: add to the selection" : "",
        e.altKey ? "Alt: drag to copy a key or to pull a fingertip" : "",
        e.shiftKey
          ? "Shift: drag to move all later keys too or to turn a link in small steps; arrow keys step 10 frames"
          : "",
      ]
        .filter(Boolean)
        .join(" · ");
    };
    // A key that is let go in the 3D view is not heard here.
    const forget = (): void => {
      held.value = "";
    };
    window.addEventListener("keydown", on);
    window.addEventListener("keyup", on);
    window.addEventListener("blur", forget);
    return () => {
      window.removeEventListener("keydown", on);
      window.removeEventListener("keyup", on);
      window.removeEventListener("blur", forget);
    };
  }, []);
  const d = store.doc.value;
  return (
    <footer class="hint">
      {store.demand.value ? <Demand of={store.demand.value} /> : null}
      {/* One row: hints that do not fit are left out whole. */}
      <div class="hints">
        {text || held.value ? (
          <b>{text || held.value}</b>
        ) : (
          (overLink.value && !store.stills.value ? LINK_HINTS : hints()).map(([k, t]) => (
            <span key={k}>
              <kbd>{k}</kbd> {t}
            </span>
          ))
        )}
      </div>
      <span>{store.selection.value.size ? `${store.selection.value.size} selected` : ""}</span>
      <span>
        {!d
          ? ""
          : d.dirty
            ? "every edit is backed up; not saved to the file yet"
            : d.path
              ? "saved"
              : "not saved to a file yet"}
      </span>
      <span>{store.link.value === "open" ? "connected" : store.link.value}</span>
    </footer>
  );
}
