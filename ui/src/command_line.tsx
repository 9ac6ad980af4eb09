// A job as the command line that does the same in a shell.

import type { JobKind } from "./protocol";

/** A word that a shell would take apart is put in quotes. */
export function shellWord(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

export function Line({ kind, args }: { kind: JobKind; args: string[] }) {
  return (
    <code class="line">
      robert {kind} {args.map(shellWord).join(" ")}
    </code>
  );
}
