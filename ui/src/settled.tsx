// What the robot holds of a key that it cannot hold, and the edit that asks for no more.

import { inUnits } from "./numbers";
import { unreachedAt } from "./span";
import * as store from "./store";
import { applyOp } from "./wire";

/** A joint with its group where its name is a code: `FFJ2 (first finger)`. */
function named(joint: string): string {
  const index = store.doc.value?.clip.robot.joints.indexOf(joint) ?? -1;
  const group = store.groups.value.find((g) => g.joints.includes(index));
  const title = store.titles.value[index] ?? joint;
  return group && /^[A-Z0-9]+$/.test(title) ? `${title} (${group.title.toLowerCase()})` : title;
}

export function Settled() {
  const d = store.doc.value;
  // A pose under a hand is another one, which has not been simulated yet.
  if (!d || store.floating.value || store.moving.value) return null;
  const lint = unreachedAt(d.findings.lints, store.playhead.value);
  if (!lint) return null;
  const [settled, fix] = [lint.settled, lint.mends[0]];
  const far = settled
    ? store.shownError(
        settled.distance,
        d.table.joints.find((j) => j.name === settled.joint)?.unit ?? store.unit.value,
      )
    : "";
  const count = lint.joints.length;
  const shared = fix?.op.op === "pose.save" ? fix.op.args.name : undefined;
  return (
    <div class="settled" role="status" data-testid="settled">
      {settled ? (
        <span>
          The robot can reach this pose within <b>{far}</b>;{" "}
          {count > 1
            ? `of ${count} joints that stay off, ${named(settled.joint)} is the farthest`
            : `only ${named(settled.joint)} stays off`}
          .
        </span>
      ) : (
        <span>{inUnits(lint.message, store.degrees.value)}</span>
      )}
      {fix ? (
        <div>
          <button
            onClick={() => void applyOp(fix.op)}
            title={
              shared === undefined
                ? fix.title
                : `Changes the pose "${shared}" for all ${settled?.held.length ?? 0} keys that use it`
            }
            data-testid="use-reachable"
          >
            {settled ? "Use the reachable pose" : fix.title}
          </button>
        </div>
      ) : null}
    </div>
  );
}
