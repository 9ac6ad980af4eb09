// What is asked about the chosen points of the graph: a factor on their values, the slope of their curves.

import { Ask } from "../ask";
import { parseNumber } from "../numbers";
import * as store from "../store";
import { passing } from "./curve";
import { actedOn, scaleValues, setTangent } from "./edits";

/** Points of this many joints, in words. */
const count = (n: number, what: string): string => `${n} ${what}${n === 1 ? "" : "s"}`;

export function ScaleValues({ onClose }: { onClose: () => void }) {
  const points = actedOn();
  const joints = new Set(points.map((p) => p.joint)).size;
  return (
    <Ask
      title={`Scale ${count(points.length, "value")} of ${count(joints, "joint")}`}
      label="Factor on the distance to the pose at the playhead"
      value="1.5"
      hint="2 doubles the motion, 0.5 halves it, -1 mirrors it. Values stay inside the joints' ranges."
      onClose={onClose}
      onDone={(t) => {
        const factor = parseNumber(t);
        if (factor === undefined) store.toast(`"${t}" is not a number`, "error");
        else void scaleValues(factor);
        return factor !== undefined;
      }}
    />
  );
}

export function Slope({ onClose }: { onClose: () => void }) {
  const clip = store.doc.value?.clip;
  const [first] = actedOn();
  if (!clip || !first) return null;
  const turns = store.doc.value?.table.joints[first.joint]?.unit !== "m";
  const degrees = turns && store.degrees.value;
  const unit = turns ? (degrees ? "°/s" : "rad/s") : "m/s";
  const scale = degrees ? Math.PI / 180 : 1;
  const own = passing(clip, first.joint, first.frame);
  const now = [own?.in, own?.out].flatMap((s) =>
    s ? [String(Number(((s.slope * clip.fps) / scale).toFixed(degrees ? 1 : 3)))] : [],
  );
  return (
    <Ask
      title={`Slope of the curve at ${count(actedOn().length, "point")}`}
      label={`${unit}, or two numbers: before and after the key`}
      value={[...new Set(now)].join(" ") || "0"}
      hint="Or a word: auto never overshoots, flat rests for a moment, linear points to the neighbouring keys."
      onClose={onClose}
      onDone={(t) => {
        if (t === "auto") return void setTangent(null);
        if (t === "flat" || t === "linear") return void setTangent(t);
        const [before, after, ...more] = t.split(/\s+/).map((x) => parseNumber(x, {}, scale));
        const typed = t.split(/\s+/).length;
        if (before === undefined || more.length > 0 || (typed === 2 && after === undefined)) {
          store.toast(`"${t}" is neither a slope in ${unit} nor auto, flat or linear`, "error");
          return false;
        }
        void setTangent(after === undefined ? before : { in: before, out: after });
        return true;
      }}
    />
  );
}
