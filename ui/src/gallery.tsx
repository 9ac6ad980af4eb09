// The first page: examples that play at once, recent files, a new clip.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { http, openWith } from "./api";
import { act } from "./actions";
import * as store from "./store";

const ROBOTS: Record<string, string> = { pointmass: "Pointmass", ur5e: "UR5e arm", ur5e_light: "UR5e arm, light damping", shadow_hand: "Shadow Hand" };

export function Gallery() {
  const robots = useSignal<{ id: string; builtin: boolean }[]>([]);
  const chosen = useSignal("shadow_hand");
  useEffect(() => {
    http<{ id: string; builtin: boolean }[]>("GET", "/api/robots").then((r) => (robots.value = r), () => undefined);
  }, []);
  return (
    <div class="gallery" data-testid="gallery">
      <h1>RoBERT Studio</h1>
      <p class="lead">Place a few poses on a timeline. A policy that learned from curiosity alone performs them in physics, and you see how near it comes while you edit.</p>
      <div class="cards">
        {store.gallery.value.map((g) => (
          <button class="card" key={g.id} onClick={() => void openWith("POST", `/api/gallery/${encodeURIComponent(g.id)}`)} data-testid={`example-${g.id}`}>
            <img src={`/api/gallery/${encodeURIComponent(g.id)}/picture.jpg`} alt="" loading="lazy" onError={(e) => (e.currentTarget.style.visibility = "hidden")} />
            <span class="body">
              <span class="title">{g.name}</span><br />
              <span class="sub">{ROBOTS[g.robot] ?? g.robot} · {(g.length / 20).toFixed(0)} s · {g.keys} keys</span>
            </span>
          </button>
        ))}
      </div>
      <h2>New clip</h2>
      <div class="row" style="margin-bottom: 22px">
        <select aria-label="Robot" value={chosen.value} onChange={(e) => (chosen.value = e.currentTarget.value)}>
          {robots.value.map((r) => <option key={r.id} value={r.id}>{ROBOTS[r.id] ?? r.id}</option>)}
        </select>
        <button class="main" onClick={() => void openWith("POST", "/api/new", { robot: chosen.value })} data-testid="new-clip">New clip</button>
        <button onClick={() => act("open")}>Open a file…</button>
        <span style="color: var(--dim)">Your own robot: <code>robert import robot.urdf --out my_robot</code></span>
      </div>
      {store.recent.value.length ? <h2>Recent</h2> : null}
      {store.recent.value.map((r) => (
        <div class="take" key={r.path} style="max-width: 760px">
          <button class="quiet" disabled={!r.exists} onClick={() => void openWith("POST", "/api/open", { path: r.path })}><b>{r.name || r.path}</b></button>
          <span class="grow" style="color: var(--dim)">{r.path}{r.exists ? "" : " (gone)"}</span>
          <span>{ROBOTS[r.robot] ?? r.robot}</span>
        </div>
      ))}
    </div>
  );
}
