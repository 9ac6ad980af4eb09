// The pose at the playhead: reaching, and the joints by group.

import { BookmarkPlus, ChevronRight, Diamond, DiamondPlus, MirrorRectangular, Move3d, Weight } from "lucide";
import { act } from "./actions/index";
import { clock, keyAt } from "./clip";
import { toggleGroup } from "./folds";
import { Icon } from "./icon";
import { Joint } from "./joint_row";
import { isLocked } from "./locks";
import { jointMoved, poseAt } from "./posing";
import { Reach } from "./reach";
import { Settled } from "./settled";
import { inClipOrder, inRobotOrder } from "./sites";
import * as store from "./store";
import { complain, http } from "./wire";

async function settle(): Promise<void> {
  const d = store.doc.value;
  if (!d) return;
  const frame = store.playhead.value;
  try {
    const answer = await http("POST /api/settle", { body: { q: inRobotOrder(poseAt(d.clip, frame)) } });
    if (store.doc.value?.opened !== d.opened) return;
    const q = inClipOrder(answer.q);
    const changes = Object.fromEntries(
      d.clip.robot.joints.flatMap((n, j) => (isLocked(n) ? [] : [[n, q[j] ?? 0]])),
    );
    const worst = Math.max(0, ...answer.residual.map(Math.abs));
    void jointMoved(changes, true, frame);
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
        <Icon of={key ? Diamond : Move3d} size={14} />
        {key ? "Key" : "Pose"} at {clock(frame, store.fps.value)}
        {key?.pose ? <small>{key.pose.replaceAll("_", " ")}</small> : null}
        <span class="grow" />
        {store.unit.value === "rad" ? (
          <button
            class="quiet small"
            onClick={() => act("unit")}
            aria-label="Switch between degrees and radians"
          >
            {store.degrees.value ? "deg" : "rad"}
          </button>
        ) : null}
      </h2>
      <Reach />
      <Settled />
      <div class="scroll">
        {rest.map((j) => (
          <Joint key={j} index={j} />
        ))}
        {store.groups.value.map((g) => (
          <details
            class="group"
            key={g.name}
            open={!store.closed.value.has(g.name)}
            onToggle={(e) => {
              if (e.currentTarget.open === store.closed.value.has(g.name)) toggleGroup(g.name);
            }}
          >
            <summary>
              <Icon of={ChevronRight} size={14} />
              {g.title}
              <small>{g.joints.length}</small>
            </summary>
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
          <Icon of={DiamondPlus} size={13} /> Key
        </button>
        <button
          onClick={() => void settle()}
          title="Simulate holding this pose and keep the pose that the robot reaches"
        >
          <Icon of={Weight} size={13} /> Settle
        </button>
        <button
          onClick={() => act("mirror")}
          disabled={store.noMirror.value !== null || store.selection.value.size === 0}
          title={store.noMirror.value ?? "Mirror the selected keys"}
        >
          <Icon of={MirrorRectangular} size={13} /> Mirror
        </button>
        <button onClick={() => act("save-pose")} title="P">
          <Icon of={BookmarkPlus} size={13} /> Save pose
        </button>
      </div>
    </section>
  );
}
