// Everything that asks something: palette, shortcut sheet, small questions, files, export.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { ACTIONS, act } from "./actions";
import { edit, openWith, poseAt, save, tell } from "./api";
import { keyAt } from "./clip";
import * as store from "./store";
import { Export } from "./export";
import { Open, Whose } from "./intake";
import { setTheme } from "./theme";

export function Dialog(props: { title: string; onClose: () => void; children: ComponentChildren; class?: string }) {
  const box = useRef<HTMLDivElement>(null);
  const close = useRef(props.onClose);
  close.current = props.onClose;
  useLayoutEffect(() => {
    const before = document.activeElement;
    const enter = (): void => {
      const first = box.current?.querySelector<HTMLElement>("input:enabled, select:enabled, button:enabled");
      // A long sheet is read from its top.
      (first ?? box.current)?.focus({ preventScroll: true });
      if (first instanceof HTMLInputElement) first.select();
    };
    // A button that is disabled while it works loses the focus to the page: its keys come here.
    const astray = (e: KeyboardEvent): void => {
      if (e.target instanceof Node && box.current?.contains(e.target)) return;
      e.stopPropagation();
      if (e.key === "Escape") return close.current();
      if (e.key === "Tab") e.preventDefault();
      enter();
    };
    enter();
    document.addEventListener("keydown", astray, true);
    return () => {
      document.removeEventListener("keydown", astray, true);
      if (before instanceof HTMLElement) before.focus();
    };
  }, []);
  const onKey = (e: KeyboardEvent): void => {
    e.stopPropagation();
    if (e.key === "Escape") props.onClose();
    if (e.key !== "Tab") return;
    const all = [...(box.current?.querySelectorAll<HTMLElement>("input:enabled, select:enabled, button:enabled, a[href]") ?? [])];
    const edge = e.shiftKey ? all[0] : all.at(-1);
    if (document.activeElement === edge) {
      e.preventDefault();
      (e.shiftKey ? all.at(-1) : all[0])?.focus();
    }
  };
  return (
    <div class="scrim" onPointerDown={(e) => e.target === e.currentTarget && props.onClose()}>
      <div class={`dialog ${props.class ?? ""}`} role="dialog" aria-modal="true" aria-label={props.title} ref={box} tabIndex={-1} onKeyDown={onKey}>
        <h2>{props.title}</h2>
        {props.children}
      </div>
    </div>
  );
}

function Ask(props: { title: string; label: string; value: string; hint?: string; onClose: () => void; onDone: (value: string) => boolean | void }) {
  const value = useSignal(props.value);
  const done = (): void => {
    if (props.onDone(value.value.trim()) !== false) props.onClose();
  };
  return (
    <Dialog title={props.title} onClose={props.onClose}>
      <form onSubmit={(e) => { e.preventDefault(); done(); }}>
        <label>{props.label}<br /><input type="text" style="width: 100%; padding: 6px 8px" value={value.value} onInput={(e) => (value.value = e.currentTarget.value)} /></label>
        {props.hint ? <p style="color: var(--dim)">{props.hint}</p> : null}
        <div class="row" style="margin-top: 12px; justify-content: flex-end">
          <button type="button" onClick={props.onClose}>Cancel</button>
          <button class="main" type="submit">OK</button>
        </div>
      </form>
    </Dialog>
  );
}

function Palette({ onClose }: { onClose: () => void }) {
  const text = useSignal("");
  const at = useSignal(0);
  const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
  const found = ACTIONS.filter((a) => words.every((w) => `${a.title} ${a.group}`.toLowerCase().includes(w)));
  const run = (id: string | undefined): void => {
    onClose();
    if (id) act(id);
  };
  return (
    <Dialog title="Find a command" onClose={onClose} class="palette">
      <input type="text" role="combobox" aria-expanded="true" aria-controls="palette-list" aria-activedescendant={found[at.value] ? `palette-${found[at.value]?.id}` : undefined} aria-label="Command" value={text.value}
        onInput={(e) => { text.value = e.currentTarget.value; at.value = 0; }}
        onKeyDown={(e) => {
          if (e.key === "ArrowDown") at.value = Math.min(found.length - 1, at.value + 1);
          else if (e.key === "ArrowUp") at.value = Math.max(0, at.value - 1);
          else if (e.key === "Enter") run(found[at.value]?.id);
          else return;
          e.preventDefault();
        }} />
      <ul id="palette-list" role="listbox">
        {found.map((a, i) => (
          <li key={a.id} id={`palette-${a.id}`} role="option" aria-selected={i === at.value} ref={(e) => { if (i === at.value) e?.scrollIntoView({ block: "nearest" }); }} onClick={() => run(a.id)} title={a.not?.() ?? ""}>
            <span style={a.not?.() ? "opacity: .5" : ""}>{a.title}</span><span>{(a.keys ?? []).slice(0, 1).map((k) => <kbd key={k}>{k}</kbd>)}</span>
          </li>
        ))}
        {found.length === 0 ? <li>nothing found</li> : null}
      </ul>
    </Dialog>
  );
}

function History({ onClose }: { onClose: () => void }) {
  const h = store.doc.value?.history;
  if (!h) return null;
  const rows = h.labels.map((label, i) => ({ label, done: h.first + i + 1 })).reverse();
  const go = (done: number): void => tell("history.goto", { done });
  return (
    <Dialog title={`History: ${h.done} of ${h.len} edits done`} onClose={onClose}>
      <ol class="history" reversed data-testid="history">
        {rows.map((r) => (
          <li key={r.done} class={r.done > h.done ? "undone" : ""}>
            <button class="quiet" aria-current={r.done === h.done ? "step" : undefined} onClick={() => go(r.done)}>{r.label}</button>
          </li>
        ))}
        {h.first > 0 ? <li class="undone">{h.first} earlier edits</li> : null}
        <li><button class="quiet" aria-current={h.done === 0 ? "step" : undefined} onClick={() => go(0)}>The clip as it was opened</button></li>
      </ol>
      <div class="row" style="margin-top: 12px; justify-content: flex-end"><button class="main" onClick={onClose}>Close</button></div>
    </Dialog>
  );
}

function Shortcuts({ onClose }: { onClose: () => void }) {
  const groups = [...new Set(ACTIONS.map((a) => a.group))];
  return (
    <Dialog title="Shortcuts" onClose={onClose}>
      {groups.map((g) => (
        <section key={g}>
          <h3 style="margin: 10px 0 4px">{g}</h3>
          <div class="keys">
            {ACTIONS.filter((a) => a.group === g && a.keys).map((a) => (
              <div key={a.id}><span>{a.title}</span><span>{a.keys?.map((k) => <kbd key={k}>{k}</kbd>)}</span></div>
            ))}
          </div>
        </section>
      ))}
      <h3 style="margin: 10px 0 4px">Mouse</h3>
      <div class="keys">
        <div><span>Move keys</span><kbd>drag</kbd></div>
        <div><span>Copy keys</span><kbd>Alt+drag</kbd></div>
        <div><span>Ripple</span><kbd>Shift+drag</kbd></div>
        <div><span>Retime about the playhead</span><kbd>S+drag</kbd></div>
        <div><span>Zoom at the pointer</span><kbd>wheel</kbd></div>
        <div><span>Pan</span><kbd>Shift+wheel</kbd></div>
        <div><span>Scroll rows</span><kbd>Alt+wheel</kbd></div>
        <div><span>Type exact values</span><kbd>double-click</kbd></div>
        <div><span>Turn a link's joint (3D view)</span><kbd>drag</kbd></div>
        <div><span>Pull a fingertip or end effector</span><kbd>Alt+drag</kbd></div>
        <div><span>Turn or pull finely</span><kbd>Shift+drag</kbd></div>
        <div><span>Give a drag up</span><kbd>Esc</kbd></div>
        <div><span>Lock or mask a row's joints</span><kbd>L M</kbd></div>
        <div><span>Length of the clip</span><kbd>drag its end</kbd></div>
        <div><span>What can be done here</span><kbd>right button</kbd></div>
        <div><span>Open a file of this computer</span><kbd>drop it on the page</kbd></div>
        <div><span>Compare with several takes</span><kbd>Ctrl+click A/B</kbd></div>
      </div>
      <div class="row" style="margin-top: 12px; justify-content: flex-end"><button class="main" onClick={onClose}>Close</button></div>
    </Dialog>
  );
}

function KeyEditor({ frame, onClose }: { frame: number; onClose: () => void }) {
  const d = store.doc.value;
  if (!d) return null;
  const key = keyAt(d.clip, frame);
  const q = poseAt(d.clip, frame);
  const at = useSignal(String(frame));
  const hold = useSignal(String(key?.hold ?? 1));
  const scale = (j: number): number => (d.table.joints[j]?.unit === "rad" && store.degrees.value ? 180 / Math.PI : 1);
  const fields = useSignal(q.map((v, j) => (v * scale(j)).toFixed(scale(j) === 1 ? 4 : 2)));
  const done = async (): Promise<void> => {
    const numbers = fields.value.map((t, j) => Number(t) / scale(j));
    if (numbers.some((n) => !Number.isFinite(n))) return store.toast("a value is no number", "error");
    const changes = Object.fromEntries(numbers.flatMap((n, j) => (Math.abs(n - (q[j] ?? 0)) > 5e-5 ? [[d.clip.robot.joints[j] ?? "", n]] : [])));
    const ops: { op: string; args: object }[] = [];
    if (Object.keys(changes).length || Number(hold.value) !== (key?.hold ?? 1)) {
      ops.push({ op: "keys.set", args: { frame, ...(Object.keys(changes).length ? { values: changes } : {}), hold: Math.max(1, Math.round(Number(hold.value))) } });
    }
    const to = Math.round(Number(at.value));
    if (Number.isFinite(to) && to !== frame) ops.push({ op: "keys.move", args: { frames: [frame], df: to - frame } });
    if (ops.length === 0 || (await edit("batch", { label: `Edit key at ${frame}`, ops }))) onClose();
  };
  return (
    <Dialog title={`Key at frame ${frame}`} onClose={onClose}>
      <form onSubmit={(e) => { e.preventDefault(); void done(); }}>
        <div class="row">
          <label>frame <input type="text" style="width: 70px" value={at.value} onInput={(e) => (at.value = e.currentTarget.value)} /></label>
          <label>hold <input type="text" style="width: 70px" value={hold.value} onInput={(e) => (hold.value = e.currentTarget.value)} /> frames</label>
        </div>
        <div style="display: grid; grid-template-columns: repeat(3, 1fr); gap: 6px 12px; margin: 12px 0">
          {fields.value.map((t, j) => (
            <label key={j} style="display: flex; justify-content: space-between; gap: 6px">{store.titles.value[j]}
              <input type="text" style="width: 84px; text-align: right" value={t} onInput={(e) => (fields.value = fields.value.map((x, i) => (i === j ? e.currentTarget.value : x)))} />
            </label>
          ))}
        </div>
        <div class="row" style="justify-content: flex-end"><button type="button" onClick={onClose}>Cancel</button><button class="main" type="submit">OK</button></div>
      </form>
    </Dialog>
  );
}

/** Achieved states in the place of the keys of a span. */
function bake(span: { from: number; to: number }, every: number): void {
  const clip = store.doc.value?.clip;
  const { q } = store.frames.value;
  if (!clip) return;
  const gone = clip.keys.map((k) => k.frame).filter((f) => f >= span.from && f < span.to);
  const keys: { frame: number; q: number[] }[] = [];
  for (let f = span.from; f < Math.min(span.to, q.length); f += every) {
    keys.push({ frame: f, q: (q[f] ?? []).map((v) => Math.round(v * 1e6) / 1e6) });
  }
  const ops = [...(gone.length ? [{ op: "keys.delete", args: { frames: gone } }] : []), { op: "keys.add", args: { keys } }];
  void edit("batch", { label: `Take as ${keys.length} keys`, ops }).then((ok) => {
    if (!ok) return;
    store.selection.value = new Set(keys.map((k) => k.frame));
    store.toast(`${keys.length} keys from the take${gone.length ? ` in the place of ${gone.length}` : ""}`, "info", true);
  });
}

/** The dialog of this name. */
export function Dialogs(props: { name: string | undefined; about: string | undefined; frame: number | undefined; onClose: () => void }) {
  const { onClose } = props;
  if (props.frame !== undefined) return <KeyEditor frame={props.frame} onClose={onClose} />;
  const frames = [...store.selection.value].sort((a, b) => a - b);
  const number = (text: string, then: (n: number) => void): boolean => {
    const n = Number(text.replace(",", "."));
    if (!Number.isFinite(n)) {
      store.toast(`"${text}" is no number`, "error");
      return false;
    }
    then(n);
    return true;
  };
  switch (props.name) {
    case "palette": return <Palette onClose={onClose} />;
    case "keys": return <Shortcuts onClose={onClose} />;
    case "history": return <History onClose={onClose} />;
    case "export": return <Export onClose={onClose} />;
    case "retime": return <Ask title="Retime" label="Factor on the distance to the playhead" value="1.5" hint="2 is twice as slow; frames are rounded" onClose={onClose} onDone={(t) => number(t, (factor) => {
      const pivot = store.playhead.value;
      void edit("keys.scale", { frames, pivot, factor }).then((ok) => ok && (store.selection.value = new Set(frames.map((f) => Math.round(pivot + (f - pivot) * factor)))));
    })} />;
    case "time": return <Ask title="Insert or remove time" label="Frames (negative removes)" value="10" hint="everything right of the playhead moves" onClose={onClose} onDone={(t) => number(t, (n) => {
      const at = store.playhead.value;
      if (n > 0) void edit("time.insert", { at, frames: Math.round(n) });
      else if (n < 0) void edit("time.delete", { from: at, to: at - Math.round(n) });
    })} />;
    case "hold": return <Ask title="Hold" label="Frames (20 are a second)" value="20" onClose={onClose} onDone={(t) => number(t, (n) => void edit("keys.hold", { frames, hold: Math.max(1, Math.round(n)) }))} />;
    case "sparsify": {
      const clip = store.doc.value?.clip;
      const some = frames.length > 2 ? frames : (clip?.keys ?? []).map((k) => k.frame);
      const metres = store.unit.value === "m";
      const scale = metres ? 1000 : store.degrees.value ? 180 / Math.PI : 1;
      const unit = metres ? "mm" : store.degrees.value ? "degrees" : "rad";
      return <Ask title={`Thin out ${frames.length > 2 ? `${some.length} selected keys` : `all ${some.length} keys`}`} label={`How far a key may lie from the line between the others, ${unit}`} value={metres ? "2" : store.degrees.value ? "2" : "0.03"} hint="the extremes of the motion stay; so do keys with a hold, a note or a pose" onClose={onClose} onDone={(t) => number(t, (n) => {
        const before = some.length;
        void edit("keys.sparsify", { frames: some, tolerance: n / scale }).then((ok) => {
          const left = new Set(store.doc.value?.clip.keys.map((k) => k.frame));
          if (ok) store.toast(`${before - some.filter((f) => left.has(f)).length} of ${before} keys went`, "info", true);
        });
      })} />;
    }
    case "densify": {
      const clip = store.doc.value?.clip;
      const span = store.range.value ?? { from: 0, to: clip?.length ?? 0 };
      return <Ask title={`The take as keys, frames ${span.from} to ${span.to - 1}`} label="A key every so many frames" value="1" hint="what was reached becomes what is commanded; thin the keys out afterwards" onClose={onClose} onDone={(t) => number(t, (n) => bake(span, Math.max(1, Math.round(n))))} />;
    }
    case "pose": return <Ask title="Save pose" label="Name" value="pose" onClose={onClose} onDone={(name) => {
      const clip = store.doc.value?.clip;
      if (!name || !clip) return false;
      void edit("pose.save", { name, q: store.floating.value ?? poseAt(clip, store.playhead.value), replace: true });
      return true;
    }} />;
    case "marker": return <Ask title="Marker" label="Name" value="mark" onClose={onClose} onDone={(name) => void edit("markers.add", { frame: store.playhead.value, name })} />;
    case "rename-marker": {
      const frame = store.playhead.value;
      const marker = store.doc.value?.clip.markers?.find((m) => m.frame === frame);
      return <Ask title="Rename marker" label="Name" value={marker?.name ?? ""} onClose={onClose} onDone={(name) => void edit("markers.set", { frame, name })} />;
    }
    case "rename-pose": {
      const old = props.about ?? "";
      return <Ask title={`Rename pose ${old}`} label="Name" value={old} hint="keys that take it follow" onClose={onClose} onDone={(to) => {
        if (!to) return false;
        if (to !== old) void edit("pose.rename", { name: old, to });
        return true;
      }} />;
    }
    case "save-as": return <Ask title="Save as" label="File" value={store.doc.value?.path ?? `${(store.doc.value?.clip.name ?? "clip").replace(/[^\w-]+/g, "_")}.clip.json`} hint={`relative to ${store.folder.value}`} onClose={onClose} onDone={(path) => void save(path)} />;
    case "replace": {
      const path = props.about ?? "";
      return (
        <Dialog title={`Replace ${path}?`} onClose={onClose}>
          <p>There is a file of that name already. What it holds would be gone.</p>
          <div class="row" style="margin-top: 12px; justify-content: flex-end">
            <button type="button" onClick={onClose}>Cancel</button>
            <button class="main" onClick={() => { onClose(); void save(path, true); }} data-testid="replace">Replace</button>
          </div>
        </Dialog>
      );
    }
    case "open": return <Open onClose={onClose} />;
    case "whose": return <Whose onClose={onClose} />;
    case "theme": return (
      <Dialog title="Theme" onClose={onClose}>
        <div class="row">{(["auto", "dark", "light"] as const).map((t) => <button key={t} onClick={() => { setTheme(t); onClose(); }}>{t}</button>)}</div>
      </Dialog>
    );
    default: return null;
  }
}
