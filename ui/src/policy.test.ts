import assert from "node:assert/strict";
import { test } from "node:test";
import { nearest, shown, type Tried, variant, withPolicy } from "./policy";
import type { Guide, PolicyCard, RolloutSettings } from "./protocol";

test("a policy brings the guide that it wants and takes it away again; between others one set by hand stays", () => {
  const card = (name: PolicyCard["name"], more: Partial<PolicyCard> = {}): PolicyCard => ({
    name,
    suits: "",
    guide: "none",
    knows_model: false,
    slow: false,
    available: true,
    learned: true,
    default: false,
    ...more,
  });
  const [pd, robert, adaptive] = [
    card("pd"),
    card("robert"),
    card("robert", { model: "adaptive", guide: "linear" }),
  ];
  const model = card("computed-torque", { knows_model: true });
  const cards = [pd, robert, adaptive, model];
  const plain: RolloutSettings = { policy: "pd", refine: false, guide: "none", seed: 0, auto: true };
  const guided = withPolicy(plain, adaptive, cards);
  assert.deepEqual(guided, { ...plain, policy: "robert", model_path: "adaptive", guide: "linear" });
  assert.deepEqual(withPolicy(guided, robert, cards), { ...plain, policy: "robert" });
  assert.equal(withPolicy({ ...plain, guide: "linear" }, robert, cards).guide, "linear");
  assert.equal(withPolicy({ ...guided, guide: "none" }, adaptive, cards).guide, "linear");

  const tried = (card: PolicyCard, guide: Guide, mae: number): Tried => ({ card, guide, mae });
  const rows = [
    tried(model, "none", 1),
    tried(adaptive, "linear", 2),
    tried(adaptive, "none", 3),
    tried(robert, "none", 4),
    tried(pd, "linear", 5),
    tried(pd, "none", 6),
  ];
  assert.deepEqual(
    shown(rows, plain).map((t) => variant(t.card, t.guide)),
    ["computed-torque", "robert:adaptive+guide", "robert", "pd+guide", "pd"],
  );
  assert.equal(variant(pd, "smooth"), "pd+smooth");
  assert.equal(nearest(rows, plain), rows[1], "the nearest that knows as little of the model");
  assert.equal(nearest(rows, guided), undefined, "nothing is nearer than the one in use");
  assert.equal(nearest(rows, { ...guided, guide: "none" }), rows[1]);
  assert.equal(
    nearest(rows, { ...plain, guide: "linear", policy: "ilqr" }),
    undefined,
    "the one in use was not tried",
  );
  assert.equal(
    nearest([tried(robert, "none", 0.95), tried(pd, "none", 1)], plain),
    undefined,
    "not worth the change",
  );
});
