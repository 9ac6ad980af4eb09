// A small picture of a clip's file or of a take; nothing where there is none.

import { useSignal } from "@preact/signals";
import { addressOf } from "./wire";

export function Thumbnail({ of }: { of: { path: string } | { take: number } }) {
  const gone = useSignal(false);
  return gone.value ? (
    <span class="thumb" aria-hidden="true" />
  ) : (
    <img
      class="thumb"
      alt=""
      loading="lazy"
      src={addressOf("GET /api/thumbnail.jpg", { query: of })}
      onError={() => (gone.value = true)}
    />
  );
}
