// What concerns the whole page: no access, no studio, no simulation, edits that were restored. It
// stands above the page and covers nothing.

import { isAnswered, setAnswered } from "./restored";
import * as store from "./store";
import { complain, http, tell } from "./wire";

/** The file, or the clip as it was begun; undo brings the edits back. */
async function discard(d: store.Document): Promise<void> {
  try {
    await http("POST /api/discard");
    setAnswered(d);
    const what = d.path ? "the clip is as the file has it" : "the unsaved edits are discarded";
    store.toast(`${what}; Ctrl+Z brings them back`, "info", true);
  } catch (e) {
    complain(e);
  }
}

export function Banner() {
  const d = store.doc.value;
  return store.link.value === "refused" ? (
    <div class="banner" role="alert">
      This page has no access. Open the address that <code>robert studio</code> printed last, with its token.
    </div>
  ) : store.link.value === "moved" ? (
    <div class="banner" role="alert" data-testid="moved">
      Another studio is running at this address, and this page has no access to it. Nothing is lost: every
      confirmed edit is on disk. Open the address that <code>robert studio</code> printed last, with its
      token.
    </div>
  ) : store.link.value === "lost" || store.link.value === "gone" ? (
    <div class="banner" role="alert" data-testid="gone">
      The studio has stopped. Nothing is lost: every confirmed edit is on disk.{" "}
      {store.link.value === "lost" ? (
        "Reconnecting…"
      ) : (
        <>
          Nothing answers at this address: start <code>robert studio</code> again and open the address that it
          prints.
        </>
      )}
    </div>
  ) : store.worker.value?.phase === "stopped" ? (
    <div class="banner" role="alert" data-testid="worker-stopped">
      The simulation stopped: {store.worker.value.reason}. You can go on editing; nothing is lost.
      <button class="main" onClick={() => tell("worker.restart")}>
        Start it again
      </button>
    </div>
  ) : d && (d.restored > 0 || d.superseded) && !isAnswered(d) && store.page.value === "editor" ? (
    <div class="banner" role="status" data-testid="restored">
      {d.restored > 0 && `Restored ${d.restored} unsaved edit${d.restored === 1 ? "" : "s"}.`}
      {d.superseded && " Another program has changed the file since. Saving replaces what it wrote."}
      <button onClick={() => setAnswered(d)}>Keep</button>
      <button onClick={() => void discard(d)}>{d.path ? "Return to the saved file" : "Discard them"}</button>
    </div>
  ) : null;
}
