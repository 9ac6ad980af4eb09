// The question whether a file that is there already is replaced.

import { Dialog } from "./dialog";

export function Replace(props: { path: string; onClose: () => void; onReplace: () => void }) {
  return (
    <Dialog title={`Replace ${props.path}?`} onClose={props.onClose}>
      <p>This name is taken already. Replacing deletes what is there.</p>
      <div class="row answers">
        <button type="button" onClick={props.onClose}>
          Cancel
        </button>
        <button
          class="main"
          onClick={() => {
            props.onClose();
            props.onReplace();
          }}
          data-testid="replace"
        >
          Replace
        </button>
      </div>
    </Dialog>
  );
}
