// Policies in words that a person can choose by; the names are those of the command line.

import type { PolicyCard, PolicyName } from "./protocol";

interface Words {
  title: string;
  /** What it does and when to take it. */
  about: string;
}

const WORDS: Record<PolicyName, Words> = {
  robert: {
    title: "Learned",
    about: "Learned from random motion. Take it when keys lie far apart or the robot model is inexact.",
  },
  ridge: {
    title: "Linear fit",
    about: "Fitted to recorded motion in seconds. Take it for robots that are nearly linear.",
  },
  pd: {
    title: "Spring and damper",
    about: "Pulls each joint to its goal. Take it for slow motion with a goal in every frame.",
  },
  "computed-torque": {
    title: "Inverse dynamics",
    about: "Computes the torque that each frame needs. Take it when goals lie close together.",
  },
  "adaptive-computed-torque": {
    title: "Inverse dynamics, identified",
    about: "Infers mass, damping and motor strength while it moves. Take it when the robot model is wrong.",
  },
  ilqr: {
    title: "Trajectory optimisation",
    about: "Plans ahead and improves its plan. Accurate when keys lie far apart; takes seconds.",
  },
  "predictive-sampling": {
    title: "Sampling planner",
    about: "Tries many motions and keeps the best. Take it for contact; takes seconds.",
  },
  zero: { title: "No torque", about: "Does nothing. Shows what gravity alone does." },
  random: {
    title: "Random torque",
    about: "Ignores the goals. Shows the error of a policy that has learned nothing.",
  },
  nearest: {
    title: "Nearest recording",
    about: "Repeats the nearest recorded motion. Shows what the recordings already contain.",
  },
  "mlp-inverse": {
    title: "Small inverse network",
    about: "Maps each step to a torque. Take it when there is a goal in every frame.",
  },
  auto: {
    title: "Automatic",
    about:
      "Tries several policies on the clip, repeats the best and corrects what it missed. A planner takes over where it is clearly nearer.",
  },
};

/** What a person reads of a policy. */
export function words(card: Pick<PolicyCard, "name" | "model" | "suits"> & { run?: string }): Words {
  const plain = WORDS[card.name];
  if (card.run) return { title: card.run, about: "Trained in this folder." };
  if (!card.model) return plain;
  return { title: `${plain.title}: ${card.model}`, about: `Best for ${card.suits}.` };
}

const OPTIONS: Record<string, string> = {
  guide: "straight in gaps",
  ilc: "corrected by repetition",
  masks: "fills gaps itself",
  refine: "refined",
  smooth: "smooth in gaps",
  sample: "sampled",
};

/** A label of the command line, such as `robert:adaptive+guide`, in words. */
export function labelInWords(label: string): string {
  const chosen = /^auto: (.+)$/.exec(label)?.[1];
  if (chosen) return `${WORDS.auto.title}: ${labelInWords(chosen)}`;
  const [policy = "", ...options] = label.split("+");
  const [name = "", model] = policy.split(":");
  const title = (WORDS as Record<string, Words>)[name]?.title ?? name;
  return [model ? `${title}: ${model}` : title, ...options.map((o) => OPTIONS[o] ?? o)].join(", ");
}
