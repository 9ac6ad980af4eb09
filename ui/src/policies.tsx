// Which policy performs: the choice in the bar, and the list with a sentence on each.

import { Check, FlaskConical, X } from "lucide";
import { Icon } from "./icon";
import {
  isAimless,
  leaving,
  nearest,
  policyId,
  shown,
  trainedFor,
  variant,
  withPolicy,
  withRun,
} from "./policy";
import { Settings } from "./policy_settings";
import { labelInWords, words } from "./policy_words";
import type { PolicyCard, RunCard, Trial } from "./protocol";
import * as store from "./store";
import { tried, tryAll, trying } from "./tryall";
import { tell } from "./wire";

const runId = (run: RunCard): string => `run:${run.path}`;

const GROUPS = ["Trained here", "Without a robot model", "With the robot model", "Not for this robot yet"];

/** A policy that can be chosen, or why not. */
interface Choice {
  id: string;
  title: string;
  about: string;
  name: string;
  why: string | undefined;
  standard: boolean;
  group: string;
}

/** The default first, then what was learned, and last what ignores the goals. */
function byUse(a: PolicyCard, b: PolicyCard): number {
  const place = (p: PolicyCard): number => (p.default ? 0 : isAimless(p) ? 3 : p.learned ? 1 : 2);
  return place(a) - place(b);
}

/** What can be chosen, what is, and how to change it. */
export function choices() {
  const settings = store.settings.value;
  const cards = store.policies.value;
  const model = settings.model_path;
  // A model of the program goes by its name, one of the user's by its path.
  const own = model && !cards.some((p) => p.model === model) ? model : undefined;
  const trained = trainedFor(store.doc.value?.clip.robot.id, store.workspace.value.runs);
  const run = trained.find((r) => r.model === model);
  const now = run ? runId(run) : model && !own ? `${settings.policy}:${model}` : settings.policy;
  const usable = (p: PolicyCard): boolean => p.available || (p.learned && own !== undefined);
  const choose = (id: string): void => {
    const run = trained.find((r) => runId(r) === id);
    if (run) return tell("rollout.set", withRun(settings, run, cards));
    const card = cards.find((p) => policyId(p) === id);
    if (!card) return;
    const path = card.name === "auto" || (card.learned && !card.available) ? own : undefined;
    tell("rollout.set", { ...withPolicy(settings, card, cards), ...(path ? { model_path: path } : {}) });
  };
  const list: Choice[] = [
    ...trained.map((r) => ({
      id: runId(r),
      title: r.path,
      about: "Trained in this folder.",
      name: r.path,
      why: undefined,
      standard: false,
      group: "Trained here",
    })),
    ...[...cards].sort(byUse).map((p) => ({
      id: policyId(p),
      ...words(p),
      name: policyId(p),
      why: usable(p) ? undefined : (p.why ?? "there is no model for this robot"),
      standard: p.default,
      group: !usable(p)
        ? "Not for this robot yet"
        : p.knows_model
          ? "With the robot model"
          : "Without a robot model",
    })),
  ];
  return { settings, cards, own, run, now, list, choose };
}

/** In the bar, always at hand. */
export function PolicySelect() {
  const { list, now, choose } = choices();
  const chosen = list.find((c) => c.id === now);
  return (
    <select
      class="policy-select"
      aria-label="Policy"
      data-testid="policy"
      title={`Policy. ${chosen?.about ?? ""}`}
      disabled={trying.value !== undefined}
      value={now}
      onChange={(e) => choose(e.currentTarget.value)}
    >
      {GROUPS.map((g) => {
        const own = list.filter((c) => c.group === g);
        return own.length ? (
          <optgroup key={g} label={g}>
            {own.map((c) => (
              <option key={c.id} value={c.id} disabled={c.why !== undefined} title={c.why ?? c.about}>
                {c.title}
              </option>
            ))}
          </optgroup>
        ) : null;
      })}
      {list.some((c) => c.id === now) ? null : <option value={now}>{now}</option>}
    </select>
  );
}

/** What every policy reached on the clip as it stands, nearest first, and which to take. */
function Tries() {
  const rows = tried.value && tried.value.rev === store.doc.value?.rev ? tried.value.rows : [];
  const settings = store.settings.value;
  const best = nearest(rows, settings);
  const use = ({ card, guide }: (typeof rows)[number]): void =>
    tell("rollout.set", { ...withPolicy(settings, card, store.policies.value), guide });
  if (trying.value)
    return (
      <p class="tries" role="status">
        Trying {trying.value} …
      </p>
    );
  if (rows.length === 0) return null;
  const name = (t: (typeof rows)[number]): string =>
    words(t.card).title + { none: "", linear: ", straight in gaps", smooth: ", smooth in gaps" }[t.guide];
  return (
    <div class="tries" data-testid="tries">
      <header>
        On this clip
        <span class="grow" />
        <button class="icon quiet" aria-label="Close the list" onClick={() => (tried.value = undefined)}>
          <Icon of={X} size={14} />
        </button>
      </header>
      {best ? (
        <p role="status">
          {name(best)} is more accurate here: {store.shownError(best.mae, store.unit.value)}{" "}
          <button class="main" onClick={() => use(best)}>
            Use it
          </button>
        </p>
      ) : null}
      {shown(rows, settings).map((t) => (
        <div class="take" key={variant(t.card, t.guide)} title={words(t.card).about}>
          <button class="quiet grow" onClick={() => use(t)}>
            {name(t)}
            {t.card.knows_model ? <small>uses the robot model</small> : null}
          </button>
          <span class="num">{store.shownError(t.mae, store.unit.value)}</span>
        </div>
      ))}
    </div>
  );
}

/** What the automatic choice compared on the clip as it stands: its choice, and then the best first. */
function Compared() {
  const r = store.rollout.value;
  if (r?.phase !== "done" || r.tried.length === 0) return null;
  const chosen = (t: Trial): boolean => r.policy === `auto: ${t.policy}`;
  const score = (t: Trial): number => (t.judged ?? Number.POSITIVE_INFINITY) + t.gaps;
  const rows = [...r.tried].sort((a, b) => Number(chosen(b)) - Number(chosen(a)) || score(a) - score(b));
  return (
    <div class="tries" data-testid="compared">
      <header>Compared on this clip</header>
      {rows.map((t) => (
        <div
          class="take"
          key={t.policy}
          title={`${t.policy} on the command line; ${t.error ?? gapsInWords(t)}${dropoutsInWords(t)}`}
        >
          <span class="grow name" aria-current={chosen(t)}>
            {chosen(t) ? <Icon of={Check} size={13} /> : null} {labelInWords(t.policy)}
          </span>
          <span class="num">
            {t.precision == null ? "failed" : store.shownError(t.precision, store.unit.value)}
            {t.gaps > 0 ? <small> +{store.shownError(t.gaps, store.unit.value)}</small> : null}
          </span>
        </div>
      ))}
      {rows.some((t) => t.gaps > 0) ? (
        <p class="swings">+: swings or jerks between the goals, or misses a frame</p>
      ) : null}
    </div>
  );
}

const gapsInWords = (t: Trial): string =>
  t.gaps > 0
    ? `its motion between the goals swings or jerks, or it misses a frame; that counts as ${store.shownError(t.gaps, store.unit.value)}`
    : "its motion between the goals is calm";

/** The error with the frames that a recording lacks, which the choice counts as well. */
const dropoutsInWords = (t: Trial): string =>
  t.with_dropouts === undefined
    ? ""
    : `; with the frames that the recording lacks its error is ${store.shownError(t.with_dropouts, store.unit.value)}`;

function Cards({ title, list }: { title: string; list: Choice[] }) {
  const { now, choose } = choices();
  if (list.length === 0) return null;
  return (
    <div class="policies" role="radiogroup" aria-label={title}>
      <h3>{title}</h3>
      {list.map((c) => (
        <button
          key={c.id}
          class="quiet policy"
          role="radio"
          aria-checked={c.id === now}
          disabled={c.why !== undefined || trying.value !== undefined}
          title={`${c.name} on the command line${c.why ? `; ${c.why}` : ""}`}
          onClick={() => choose(c.id)}
          data-testid={`policy-${c.id}`}
        >
          <b>
            {c.title}
            {c.standard ? <span class="tag">default</span> : null}
          </b>
          <span>{c.why ?? c.about}</span>
        </button>
      ))}
    </div>
  );
}

export function Policies() {
  const { settings, cards, own, list } = choices();
  const r = store.rollout.value;
  return (
    <section class="panel fill" aria-label="Policies" data-testid="policies">
      <div class="scroll">
        <button
          class="wide"
          data-testid="try-all"
          disabled={trying.value !== undefined || r?.phase !== "done"}
          title="Perform the clip with every fast policy and suggest the most accurate one"
          onClick={() => void tryAll()}
        >
          <Icon of={FlaskConical} size={14} /> Try all on this clip
        </button>
        <Tries />
        <Compared />
        {GROUPS.map((g) => (
          <Cards key={g} title={g} list={list.filter((c) => c.group === g)} />
        ))}
        {own ? (
          <div class="take">
            <span class="grow" title={own}>
              model {own.split("/").slice(-3).join("/")}
            </span>
            <button
              class="icon quiet"
              aria-label="Stop using this model"
              onClick={() => {
                const rest = leaving(settings, cards);
                tell("rollout.set", { ...rest, policy: cards.find((p) => p.default)?.name ?? rest.policy });
              }}
            >
              <Icon of={X} size={14} />
            </button>
          </div>
        ) : null}
        <Settings />
      </div>
    </section>
  );
}
