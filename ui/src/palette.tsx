// The search over all that has a name, and the sheet of shortcuts.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { ACTIONS } from "./actions/index";
import { CloseRow, Dialog } from "./dialog";
import { refreshGallery } from "./documents";
import { Icon } from "./icon";
import { type Found, SIGNS, search } from "./search";

export function Palette({ onClose }: { onClose: () => void }) {
  const text = useSignal("");
  const at = useSignal(0);
  useEffect(() => void refreshGallery(), []);
  const found = search(text.value);
  const run = (f: Found | undefined): void => {
    onClose();
    f?.run();
  };
  return (
    <Dialog title="Search" onClose={onClose} class="palette">
      <input
        type="text"
        role="combobox"
        aria-expanded="true"
        aria-controls="palette-list"
        aria-activedescendant={found[at.value] ? `palette-${found[at.value]?.id}` : undefined}
        aria-label="Command"
        placeholder="Joints, poses, policies, examples, files, commands"
        value={text.value}
        onInput={(e) => {
          text.value = e.currentTarget.value;
          at.value = 0;
        }}
        onKeyDown={(e) => {
          if (e.key === "ArrowDown") at.value = Math.min(found.length - 1, at.value + 1);
          else if (e.key === "ArrowUp") at.value = Math.max(0, at.value - 1);
          else if (e.key === "Enter") run(found[at.value]);
          else return;
          e.preventDefault();
        }}
      />
      <ul id="palette-list" role="listbox">
        {found.map((f, i) => (
          <li
            key={f.id}
            id={`palette-${f.id}`}
            role="option"
            aria-selected={i === at.value}
            aria-disabled={f.why ? "true" : undefined}
            ref={(e) => {
              if (i === at.value) e?.scrollIntoView({ block: "nearest" });
            }}
            onClick={() => run(f)}
            title={f.why ?? f.kind}
          >
            <Icon of={SIGNS[f.kind]} size={14} />
            <span class="grow">{f.title}</span>
            {f.kind === "Command" ? null : (
              <span class="of">
                {f.kind}
                {f.of ? `, ${f.of}` : ""}
              </span>
            )}
            {f.keys ? <kbd>{keyText(f.keys)}</kbd> : null}
          </li>
        ))}
        {found.length === 0 ? <li>Nothing has this name.</li> : null}
      </ul>
    </Dialog>
  );
}

/** A key as it is printed on keyboards. */
const SIGN: Record<string, string> = {
  ArrowUp: "↑",
  ArrowDown: "↓",
  ArrowLeft: "←",
  ArrowRight: "→",
  Escape: "Esc",
  Delete: "Del",
  ContextMenu: "Menu",
};
const keyText = (keys: string): string => keys.replace(/\w+$/, (key) => SIGN[key] ?? key);

export function Shortcuts({ onClose }: { onClose: () => void }) {
  const groups = [...new Set(ACTIONS.map((a) => a.group))];
  return (
    <Dialog title="Shortcuts" onClose={onClose}>
      {groups.map((g) => (
        <section key={g}>
          <h3 style="margin: 10px 0 4px">{g}</h3>
          <div class="keys">
            {ACTIONS.filter((a) => a.group === g && a.keys).map((a) => (
              <div key={a.id}>
                <span>{a.title}</span>
                <span>
                  {a.keys?.map((k) => (
                    <kbd key={k}>{keyText(k)}</kbd>
                  ))}
                </span>
              </div>
            ))}
          </div>
        </section>
      ))}
      <h3 style="margin: 10px 0 4px">Mouse</h3>
      <div class="keys">
        <div>
          <span>Move keys</span>
          <kbd>drag</kbd>
        </div>
        <div>
          <span>Copy keys</span>
          <kbd>Alt+drag</kbd>
        </div>
        <div>
          <span>Move keys and all later ones</span>
          <kbd>Shift+drag</kbd>
        </div>
        <div>
          <span>Retime about the playhead</span>
          <kbd>S+drag</kbd>
        </div>
        <div>
          <span>Zoom at the pointer</span>
          <kbd>wheel</kbd>
        </div>
        <div>
          <span>Pan</span>
          <kbd>Shift+wheel</kbd>
        </div>
        <div>
          <span>Scroll rows</span>
          <kbd>Alt+wheel</kbd>
        </div>
        <div>
          <span>Type exact values</span>
          <kbd>double-click</kbd>
        </div>
        <div>
          <span>Turn a link's joint (3D view)</span>
          <kbd>drag</kbd>
        </div>
        <div>
          <span>Pull a fingertip or end effector</span>
          <kbd>Alt+drag</kbd>
        </div>
        <div>
          <span>Turn or pull in small steps</span>
          <kbd>Shift+drag</kbd>
        </div>
        <div>
          <span>Cancel a drag</span>
          <kbd>Esc</kbd>
        </div>
        <div>
          <span>Lock or mask a row's joints</span>
          <kbd>L M</kbd>
        </div>
        <div>
          <span>Length of the clip</span>
          <kbd>drag its end</kbd>
        </div>
        <div>
          <span>Open the menu</span>
          <kbd>right-click</kbd>
        </div>
        <div>
          <span>Open a file from this computer</span>
          <kbd>drop it on the page</kbd>
        </div>
        <div>
          <span>Compare with several takes</span>
          <kbd>Ctrl+click A/B</kbd>
        </div>
      </div>
      <CloseRow onClose={onClose} />
    </Dialog>
  );
}
