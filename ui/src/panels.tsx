// The smaller panels: problems, takes, poses.

import { useSignal } from "@preact/signals";
import { seek } from "./actions/playback";
import { openDialog } from "./dialog";
import { unlockedOnly } from "./locks";
import { openMenu } from "./menu";
import { leaving, nearest, policyId, shown, trainedFor, variant, withPolicy, withRun } from "./policy";
import { NoModel, Settings } from "./policy_settings";
import type { Op, RunCard } from "./protocol";
import * as store from "./store";
import { TakeList } from "./takes";
import { tried, tryAll, trying } from "./tryall";
import { addressOf, applyOp, edit, tell } from "./wire";

export function Problems() {
  const lints = store.doc.value?.findings.lints ?? [];
  return (
    <section class="panel problems" aria-label="Problems" data-testid="problems">
      <h2>{lints.length ? `Problems (${lints.length})` : "No problems"}</h2>
      <div class="scroll">
        {lints.map((l, i) => (
          <div class={`problem ${l.level}`} key={`${l.rule}${i}`}>
            <span class="mark" role="img" aria-label={l.level}>
              {l.level === "error" ? "✖" : l.level === "warning" ? "!" : "i"}
            </span>
            <div>
              <p>
                {l.frames ? (
                  <button class="quiet" style="padding: 0 4px" onClick={() => seek(l.frames?.[0] ?? 0)}>
                    {l.frames[0]}
                  </button>
                ) : null}{" "}
                {l.message}
              </p>
              {l.mends.length ? (
                <div class="mends">
                  {l.mends.map((m) => (
                    <button key={m.title} onClick={() => void applyOp(m.op)}>
                      {m.title}
                    </button>
                  ))}
                </div>
              ) : null}
            </div>
          </div>
        ))}
      </div>
    </section>
  );
}

/** A policy's name, broken where its parts meet if it must be. */
function Breakable({ name }: { name: string }) {
  return (
    <>
      {name.split(/(?<=:)|(?=\+)/).map((part, i) => (
        <>
          {i ? <wbr /> : null}
          {part}
        </>
      ))}
    </>
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
        trying {trying.value} …
      </p>
    );
  if (rows.length === 0) return null;
  return (
    <div class="tries" data-testid="tries">
      <button
        class="quiet close"
        aria-label="Close the list"
        title="Close"
        onClick={() => (tried.value = undefined)}
      >
        ×
      </button>
      {best ? (
        <p role="status">
          {variant(best.card, best.guide)} is more accurate on this clip:{" "}
          {store.shownError(best.mae, store.unit.value)} <button onClick={() => use(best)}>Use it</button>
        </p>
      ) : null}
      {shown(rows, settings).map((t) => (
        <div class="take" key={variant(t.card, t.guide)} title={`Best for: ${t.card.suits}`}>
          <button class="quiet grow" onClick={() => use(t)}>
            <Breakable name={variant(t.card, t.guide)} />
            {t.card.knows_model ? <small> uses the robot model</small> : null}
          </button>
          <span class="num">{store.shownError(t.mae, store.unit.value)}</span>
        </div>
      ))}
    </div>
  );
}

const runId = (run: RunCard): string => `run:${run.path}`;

export function Takes() {
  const r = store.rollout.value;
  const set = (change: Partial<typeof store.settings.value>): void =>
    tell("rollout.set", { ...store.settings.value, ...change });
  const known = store.policies.value;
  const model = store.settings.value.model_path;
  // A model of the program goes by its name, one of the user's by its path.
  const own = model && !known.some((p) => p.model === model) ? model : undefined;
  const trained = trainedFor(store.doc.value?.clip.robot.id, store.workspace.value.runs);
  const run = trained.find((r) => r.model === model);
  const now = run
    ? runId(run)
    : model && !own
      ? `${store.settings.value.policy}:${model}`
      : store.settings.value.policy;
  const card = known.find((p) => policyId(p) === now);
  const choose = (id: string): void => {
    const run = trained.find((r) => runId(r) === id);
    if (run) return tell("rollout.set", withRun(store.settings.value, run, known));
    const card = known.find((p) => policyId(p) === id);
    if (!card) return;
    const path = card.learned && !card.available ? own : undefined;
    tell("rollout.set", {
      ...withPolicy(store.settings.value, card, known),
      ...(path ? { model_path: path } : {}),
    });
  };
  return (
    <section class="panel" aria-label="Takes" data-testid="takes">
      <h2>
        Rollout <span class="grow" />
        <button
          class="quiet"
          data-testid="try-all"
          disabled={trying.value !== undefined || r?.phase !== "done"}
          title="Run the clip with every fast policy and suggest the most accurate one"
          onClick={() => void tryAll()}
        >
          Try all
        </button>
      </h2>
      <div class="scroll" style="flex: none">
        <fieldset class="row bare" style="gap: 4px 8px" disabled={trying.value !== undefined}>
          <select
            aria-label="Policy"
            data-testid="policy"
            title={card ? `Best for: ${card.suits}` : ""}
            style="flex: 1 1 112px; min-width: 0"
            value={now}
            onChange={(e) => choose(e.currentTarget.value)}
          >
            {known.map((p) => (
              <option
                key={policyId(p)}
                value={policyId(p)}
                disabled={!p.available && !(p.learned && own)}
                title={p.why ?? `Best for: ${p.suits}`}
              >
                {policyId(p)}
                {p.default && !(own && policyId(p) === now) ? " (default)" : ""}
                {p.available || (p.learned && own) ? "" : " – no model"}
              </option>
            ))}
            {own && !run && !known.some((p) => policyId(p) === now) ? (
              <option value={now}>{now}</option>
            ) : null}
            {trained.length ? (
              <optgroup label="Trained here">
                {trained.map((r) => (
                  <option key={r.path} value={runId(r)}>
                    {r.path}
                  </option>
                ))}
              </optgroup>
            ) : null}
          </select>
          <label title="Improves each action of the policy by one planning step on the robot model">
            <input
              type="checkbox"
              checked={store.settings.value.refine}
              onChange={(e) => set({ refine: e.currentTarget.checked })}
            />{" "}
            refine
          </label>
          <Settings />
        </fieldset>
        <NoModel />
        {card && !tried.value ? <p class="suits">Best for: {card.suits}</p> : null}
        <Tries />
        {own ? (
          <div class="take">
            <span class="grow" title={own}>
              model {own.split("/").slice(-3).join("/")}
            </span>
            <button
              class="quiet"
              aria-label="Stop using this model"
              onClick={() => {
                const rest = leaving(store.settings.value, known);
                tell("rollout.set", { ...rest, policy: known.find((p) => p.default)?.name ?? rest.policy });
              }}
            >
              ×
            </button>
          </div>
        ) : null}
      </div>
      <TakeList />
    </section>
  );
}

export function Poses() {
  const blend = useSignal(100);
  const find = useSignal("");
  const mirrored = useSignal(false);
  const d = store.doc.value;
  if (!d) return null;
  const own = Object.keys(d.clip.poses ?? {});
  const given = (store.robot.value?.poses ?? []).map((p) => p.name);
  // A pose of the robot keeps its place when the clip gets a copy of it.
  const names = [...own.filter((n) => !given.includes(n)), ...given].filter((n) =>
    n.toLowerCase().includes(find.value.toLowerCase()),
  );
  const apply = (name: string): void => {
    const frames = store.selection.value.size ? [...store.selection.value] : [store.playhead.value];
    const ops: Op[] = [];
    const builtin = store.robot.value?.poses.find((p) => p.name === name);
    if (!own.includes(name) && builtin) ops.push({ op: "pose.save", args: { name, q: builtin.q } });
    ops.push({
      op: "pose.apply",
      args: { name, frames, blend: blend.value / 100, mirrored: mirrored.value, ...unlockedOnly() },
    });
    void (ops.length === 1 && ops[0] ? applyOp(ops[0]) : edit("batch", { label: `Apply pose ${name}`, ops }));
  };
  /** Another picture is asked for when the pose changes. */
  const version = (name: string): string =>
    `${d.clip.robot.id}${own.includes(name) ? JSON.stringify(d.clip.poses?.[name]) : ""}`.slice(0, 600);
  const menu = (e: MouseEvent, name: string): void => {
    e.preventDefault();
    const why = own.includes(name)
      ? null
      : "this pose belongs to the robot; apply it once to copy it into the clip";
    openMenu(`Pose ${name}`, { x: e.clientX, y: e.clientY }, [
      { title: "Apply", run: () => apply(name) },
      { title: "Rename…", why, run: () => openDialog({ name: "rename-pose", pose: name }) },
      {
        title: "Delete",
        why,
        run: () =>
          void edit("pose.delete", { name }).then(
            (ok) =>
              ok && store.toast(`pose ${name} deleted; keys that used it keep its values`, "info", true),
          ),
      },
    ]);
  };
  return (
    <section class="panel fill" aria-label="Poses" data-testid="poses">
      <h2>Poses</h2>
      <div class="scroll">
        {names.length > 8 || find.value ? (
          <input
            type="text"
            placeholder="find"
            aria-label="Find a pose"
            style="width: 100%; margin-bottom: 6px"
            value={find.value}
            onInput={(e) => (find.value = e.currentTarget.value)}
          />
        ) : null}
        <div class="poses">
          {names.map((name) => (
            <button
              class="pose"
              key={name}
              data-menu
              onClick={() => apply(name)}
              onContextMenu={(e) => menu(e, name)}
              title={`Apply ${name} at the playhead or to the selected keys; right-click or Shift+F10 to rename or delete it`}
              data-testid={`pose-${name}`}
            >
              <img
                src={addressOf("GET /api/pose.jpg", { query: { pose: name, v: version(name) } })}
                alt=""
                loading="lazy"
                onError={(e) => (e.currentTarget.style.visibility = "hidden")}
              />
              {name}
            </button>
          ))}
        </div>
        <label style="display: block; margin-top: 8px">
          blend {blend.value} %
          <input
            type="range"
            min={0}
            max={100}
            step={5}
            value={blend.value}
            onInput={(e) => (blend.value = Number(e.currentTarget.value))}
          />
        </label>
        <label title={store.noMirror.value ?? ""}>
          <input
            type="checkbox"
            disabled={store.noMirror.value !== null}
            checked={mirrored.value}
            onChange={(e) => (mirrored.value = e.currentTarget.checked)}
          />{" "}
          mirrored
        </label>
      </div>
    </section>
  );
}
