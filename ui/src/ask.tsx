// A question with one field.

import { useSignal } from "@preact/signals";
import { Answers, Dialog } from "./dialog";

export function Ask(props: {
  title: string;
  label: string;
  value: string;
  hint?: string;
  onClose: () => void;
  /** False keeps the dialog open. */
  onDone: (value: string) => boolean | undefined;
}) {
  const value = useSignal(props.value);
  const done = (): void => {
    if (props.onDone(value.value.trim()) !== false) props.onClose();
  };
  return (
    <Dialog title={props.title} onClose={props.onClose}>
      <form
        onSubmit={(e) => {
          e.preventDefault();
          done();
        }}
      >
        <label>
          {props.label}
          <br />
          <input
            type="text"
            style="width: 100%; padding: 6px 8px"
            value={value.value}
            onInput={(e) => (value.value = e.currentTarget.value)}
          />
        </label>
        {props.hint ? <p style="color: var(--dim)">{props.hint}</p> : null}
        <Answers onClose={props.onClose} />
      </form>
    </Dialog>
  );
}
