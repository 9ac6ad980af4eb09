// Signs of the Lucide set. Each is imported by name where it is used, so only those are bundled.

import type { IconNode } from "lucide";
import { h } from "preact";

/** A sign says nothing by itself: what it stands for is the name of its button. */
export function Icon({ of, size = 16 }: { of: IconNode; size?: number }) {
  return (
    <svg
      class="sign"
      width={size}
      height={size}
      viewBox="0 0 24 24"
      fill="none"
      stroke="currentColor"
      stroke-width={size < 14 ? 2.5 : 2}
      stroke-linecap="round"
      stroke-linejoin="round"
      aria-hidden="true"
    >
      {of.map(([tag, attributes], i) => h(tag, { ...attributes, key: i }))}
    </svg>
  );
}
