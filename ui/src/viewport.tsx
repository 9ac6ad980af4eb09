// The 3D view: viser's client in a same-origin frame, driven by our server. Without it, or
// without WebGL, pictures rendered by the server, with the same selection and sliders.

import { PencilLine } from "lucide";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { act } from "./actions/index";
import { toggleShow } from "./actions/view";
import { startsAway } from "./clip";
import { Draw, drawing } from "./draw";
import { hover, hoverEnds, Tip } from "./hover";
import { Icon } from "./icon";
import { dropFloating, keyFloating } from "./posing";
import type { Stage } from "./protocol";
import { useStill } from "./rendered";
import { DRAWS, shadows } from "./shadows";
import { install } from "./shortcuts";
import { inRobotOrder } from "./sites";
import { Splitter } from "./splitter";
import * as store from "./store";
import { isDark, palette, stageColors } from "./theme";
import { complain, http, tell } from "./wire";

/** Viser's own panel and notices would cover the robot; the shell has its own. */
const HIDE =
  "[data-floating-window],[data-testid='floating-panel'],.mantine-Notifications-root{display:none!important}";

/** How Automatic improves the motion, in words. */
const STAGES: Record<Stage, string> = {
  correct: "correcting the goals",
  plan: "planning a path",
  follow: "following the path",
  search: "searching for a better motion",
  soften: "softening the gaps",
};

/** The background behind the robot. The canvas of the scene is transparent where nothing is drawn. */
const stage = (): string =>
  `canvas[data-engine]{background:radial-gradient(ellipse at 50% 42%,${stageColors()})}`;

/** Viser's client loads a sorter for splats that makes functions from text. The page's security policy
 * forbids that, so each start would leave an error in the console. This scene has no splats, so the
 * request for the sorter is never answered. The frame's window exists before its page is loaded, so the
 * client already uses the `fetch` that is set here. */
function withoutSorter(inner: Window & typeof globalThis): void {
  const real = inner.fetch.bind(inner);
  inner.fetch = (what, ...rest) =>
    String(what).startsWith("data:application/wasm") ? new Promise(() => undefined) : real(what, ...rest);
}

export function Viewport() {
  const frame = useRef<HTMLIFrameElement>(null);
  const stills = !store.viser.value || DRAWS === undefined;
  // Once: another address would load the 3D view anew.
  const dark = useRef(isDark()).current;

  useEffect(() => void (store.stills.value = stills), [stills]);
  useLayoutEffect(() => {
    const inner = frame.current?.contentWindow;
    if (inner) withoutSorter(inner as Window & typeof globalThis);
  }, [stills]);
  useEffect(() => {
    let last = -1;
    let timer = 0;
    // The viewport shows the playhead; while playing, the server keeps its own clock (playback.ts).
    const dispose = store.playhead.subscribe((f) => {
      if (store.playing.value || f === last) return;
      last = f;
      clearTimeout(timer);
      timer = window.setTimeout(() => tell("view.frame", { frame: f }), 12);
    });
    const themed = palette.subscribe(() => {
      tell("view.show", { dark: isDark() });
      const own = frame.current?.contentDocument?.querySelector("#stage");
      if (own) own.textContent = stage();
    });
    return () => {
      dispose();
      themed();
    };
  }, []);

  const loaded = (): void => {
    const inner = frame.current?.contentWindow;
    const page = frame.current?.contentDocument;
    if (!inner || !page) return;
    const style = page.createElement("style");
    style.textContent = HIDE;
    const behind = page.createElement("style");
    behind.id = "stage";
    behind.textContent = stage();
    page.head.append(style, behind);
    install(inner as Window);
    inner.addEventListener("pointermove", (e) => {
      const { innerWidth: w, innerHeight: h } = inner;
      const [x, y] = [e.clientX / w, e.clientY / h];
      // A hand that holds something keeps its name and value beside it; one that turns the camera needs none.
      if (e.buttons && !store.moving.value) return hoverEnds();
      hover(e.clientX, e.clientY, async () =>
        store.moving.value
          ? ""
          : ((await http("GET /api/hover", { query: { tab: store.TAB, x, y } }))?.body ?? null),
      );
    });
    page.addEventListener("pointerleave", hoverEnds);
    tell("view.show", { ...store.show.value, dark: isDark(), shadows: shadows.value });
    // Its socket only reconnects while its document has the focus.
    frame.current?.addEventListener("pointerenter", () => inner.focus());
  };

  const r = store.rollout.value;
  // No policy can mend the first frame: the mean leaves it out, so it is said apart.
  const clip = store.doc.value?.clip;
  const off = clip && startsAway(clip, store.frames.value.q[0]);
  const apart = off !== undefined && off > 0.005 ? off : undefined;
  const phase =
    !r || r.phase === "off"
      ? "not simulated"
      : r.phase === "failed"
        ? "failed"
        : r.phase === "done"
          ? ""
          : r.cached_to < r.frames
            ? `rollout ${r.cached_to}/${r.frames}`
            : // Every frame is there: only Automatic goes on, with the other policies.
              r.stage
              ? STAGES[r.stage]
              : "comparing policies";
  return (
    <main class="viewport" aria-label="Viewport" data-testid="viewport">
      {stills ? (
        <Stills />
      ) : (
        <iframe
          ref={frame}
          title="3D view"
          onLoad={loaded}
          src={`/viser/?websocket=${encodeURIComponent(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/viser?tab=${store.TAB}`)}${dark ? "&darkMode" : ""}`}
        />
      )}
      <div class="legend" role="group" aria-label="Shown">
        <button
          aria-pressed={store.show.value.command}
          onClick={() => toggleShow("command")}
          title="The commanded motion, translucent; links turn from blue to red as their error grows (1)"
        >
          <i class="is-command" />
          Command
        </button>
        <button
          aria-pressed={store.show.value.achieved}
          onClick={() => toggleShow("achieved")}
          title="The motion that the policy reached, solid (2)"
        >
          <i class="is-achieved" />
          Achieved
        </button>
        <button
          aria-pressed={store.show.value.ghosts}
          onClick={() => toggleShow("ghosts")}
          title="Poses of the neighbouring keys: green before, amber after (4)"
        >
          <i class="is-ghosts" />
          Ghosts
        </button>
        <button
          aria-pressed={store.show.value.path}
          disabled={stills}
          onClick={() => toggleShow("path")}
          title={
            stills
              ? "Still pictures show no paths"
              : "The path of the selected link or end effector: drag a diamond to move that key, click the line for a new one (5)"
          }
        >
          <i class="is-path" />
          Path
        </button>
        <button
          aria-pressed={store.show.value.reachable}
          disabled={stills}
          onClick={() => toggleShow("reachable")}
          title={
            stills
              ? "Still pictures do not show the reachable pose; the panel on the right says how far it is"
              : "Where a key asks for a pose that the robot cannot reach: the pose that it can (6)"
          }
        >
          <i class="is-reachable" />
          Reachable
        </button>
        <button
          aria-pressed={drawing.value}
          onClick={() => act("draw")}
          title="Draw a motion with an end effector (D)"
          data-testid="draw-button"
        >
          <Icon of={PencilLine} size={14} />
          Draw
        </button>
        <select
          aria-label="View"
          data-testid="view"
          value=""
          disabled={stills}
          title={stills ? "Still pictures have one view only" : "F shows the selected link"}
          onChange={(e) => {
            act(e.currentTarget.value);
            e.currentTarget.value = "";
          }}
        >
          <option value="">View</option>
          {[
            ["view-home", "Whole motion"],
            ["view-front", "Front"],
            ["view-side", "Side"],
            ["view-top", "Top"],
            ["frame", "Selected link"],
          ].map(([id, title]) => (
            <option key={id} value={id}>
              {title}
            </option>
          ))}
        </select>
      </div>
      <Draw />
      <Tip />
      {store.floating.value ? (
        <div class="floating">
          This pose is not a key yet.
          <button class="main" onClick={() => void keyFloating()}>
            Make it a key (K)
          </button>
          <button onClick={() => dropFloating()}>Discard</button>
        </div>
      ) : null}
      <div class="badge" aria-live="off" data-testid="badge">
        {phase ? <span>{phase} </span> : null}
        {r?.error ? <span style="color: var(--bad)">{r.error} </span> : null}
        {r?.mae !== null && r?.mae !== undefined ? (
          <span>
            <b>{store.shownError(r.mae, store.unit.value)}</b> mean error
          </span>
        ) : null}
        {apart !== undefined ? (
          <span title="Distance from the first key when the motion starts. No policy can change it, so the mean error leaves this frame out">
            {" "}
            · starts <b>{store.shownError(apart, store.unit.value)}</b> away
          </span>
        ) : null}
        {(r?.ms_per_frame ?? 0) >= 0.05 && r ? (
          <span class="num">
            {r.mae === null ? "" : " · "}
            {r.ms_per_frame?.toFixed(1)} ms a frame
          </span>
        ) : null}
      </div>
      <Splitter of="left" />
      <Splitter of="right" />
    </main>
  );
}

function Stills() {
  const host = useRef<HTMLDivElement>(null);
  const size = (): { w: number; h: number } => {
    const w = host.current?.clientWidth ?? 960;
    const h = host.current?.clientHeight ?? 600;
    const shrink = Math.min(1, 960 / Math.max(w, h));
    return { w: Math.max(64, Math.round(w * shrink)), h: Math.max(64, Math.round(h * shrink)) };
  };
  const { url, error, waiting } = useStill(
    () => ({
      ...size(),
      draft: true,
      shown: {
        achieved: store.show.value.achieved,
        command: store.show.value.command,
        ghosts: store.show.value.ghosts,
        ...(store.floating.value ? { pose: inRobotOrder(store.floating.value).join() } : {}),
      },
    }),
    host,
  );
  const bodyAt = async (e: { clientX: number; clientY: number }): Promise<string | null> => {
    const box = host.current?.getBoundingClientRect();
    if (!box) return null;
    const { w, h } = size();
    const [x, y] = [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height];
    const frame = Math.round(store.playhead.value);
    return http("GET /api/still-body", { query: { frame, w, h, x, y } });
  };
  const over = (e: PointerEvent): void => {
    const box = host.current?.getBoundingClientRect();
    const at = { clientX: e.clientX, clientY: e.clientY };
    if (box && url.value) hover(e.clientX - box.left, e.clientY - box.top, () => bodyAt(at));
  };
  /** The link under the mouse is selected, as in the 3D view. */
  const pick = async (e: MouseEvent): Promise<void> => {
    try {
      const body = await bodyAt(e);
      tell("view.select", body ? { body } : {});
    } catch (error) {
      complain(error);
    }
  };
  return (
    <div
      ref={host}
      class="stills"
      onClick={(e) => void pick(e)}
      onPointerMove={over}
      onPointerLeave={hoverEnds}
    >
      {url.value ? (
        <img
          src={url.value}
          alt="The robot at the playhead"
          aria-busy={waiting.value}
          data-testid="still-view"
        />
      ) : null}
      <p>
        {error.value ||
          `Still pictures: ${store.viser.value ? "this browser has no WebGL" : "this build has no 3D client; script/bootstrap fetches it"}`}
      </p>
    </div>
  );
}
