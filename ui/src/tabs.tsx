// A row of tabs: one in front, arrows go from one to the next.

import type { IconNode } from "lucide";
import { Icon } from "./icon";

interface Tab<T extends string> {
  id: T;
  title: string;
  sign?: IconNode;
  /** A small number beside the title. */
  count?: number | undefined;
}

export function Tabs<T extends string>(props: {
  label: string;
  tabs: Tab<T>[];
  now: T;
  onChoose: (id: T) => void;
}) {
  const onKey = (e: KeyboardEvent): void => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
    if (step === undefined) return;
    e.preventDefault();
    e.stopPropagation();
    const at = props.tabs.findIndex((t) => t.id === props.now) + step;
    const next = props.tabs[(at + props.tabs.length) % props.tabs.length];
    if (!next) return;
    props.onChoose(next.id);
    document.getElementById(`tab-${next.id}`)?.focus();
  };
  return (
    <div class="tabs" role="tablist" aria-label={props.label} onKeyDownCapture={onKey}>
      {props.tabs.map((t) => (
        <button
          key={t.id}
          id={`tab-${t.id}`}
          role="tab"
          aria-selected={t.id === props.now}
          tabIndex={t.id === props.now ? 0 : -1}
          onClick={() => props.onChoose(t.id)}
          data-testid={`tab-${t.id}`}
        >
          {t.sign ? <Icon of={t.sign} size={14} /> : null}
          {t.title}
          {t.count ? <small>{t.count}</small> : null}
        </button>
      ))}
    </div>
  );
}
