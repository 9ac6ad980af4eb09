// How an offset grows, stays and fades, typed.

import { useSignal } from "@preact/signals";
import { clock } from "./clip";
import { Answers, Dialog } from "./dialog";
import { wholeFrames } from "./key_editor";
import { chosen } from "./offsets";
import * as store from "./store";
import { edit } from "./wire";

export function OffsetFades({ onClose }: { onClose: () => void }) {
  const own = chosen();
  const fields = useSignal([String(own?.in ?? 10), String(own?.hold ?? 1), String(own?.out ?? 10)]);
  if (!own) return null;
  const done = (): void => {
    const [fadeIn, hold, fadeOut] = fields.value.map(wholeFrames);
    if (fadeIn === undefined || !hold || fadeOut === undefined)
      return store.toast("type frames, such as 10, or a time such as 0.5s", "error");
    onClose();
    void edit("offsets.set", { frame: own.frame, in: fadeIn, hold, out: fadeOut });
  };
  const field = (title: string, at: number) => (
    <label>
      {title}
      <br />
      <input
        type="text"
        class="time"
        value={fields.value[at]}
        onInput={(e) => (fields.value = fields.value.map((t, i) => (i === at ? e.currentTarget.value : t)))}
      />
    </label>
  );
  return (
    <Dialog title={`Offset at ${clock(own.frame, store.fps.value)}`} onClose={onClose}>
      <form
        onSubmit={(e) => {
          e.preventDefault();
          done();
        }}
      >
        <div class="row" style="gap: 16px">
          {field("Grows over", 0)}
          {field("Stays for", 1)}
          {field("Fades over", 2)}
        </div>
        <p style="color: var(--dim)">
          Frames of 1/20 s, or a time such as 0.5s. Offsets whose fades meet lead into each other.
        </p>
        <Answers onClose={onClose} />
      </form>
    </Dialog>
  );
}
