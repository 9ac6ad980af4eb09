// How curves pass the chosen points of the graph.

import { needsPoint, setTangent } from "../graph/edits";
import { type Action, dialog } from "./action";

export const TANGENTS: Action[] = [
  {
    id: "tangent-auto",
    title: "Tangent: automatic, never overshoots",
    group: "Keys",
    not: needsPoint,
    run: () => void setTangent(null),
  },
  {
    id: "tangent-flat",
    title: "Tangent: flat, the joint rests for a moment",
    group: "Keys",
    not: needsPoint,
    run: () => void setTangent("flat"),
  },
  {
    id: "tangent-linear",
    title: "Tangent: along the lines to the neighbouring keys",
    group: "Keys",
    not: needsPoint,
    run: () => void setTangent("linear"),
  },
  {
    id: "tangent-slope",
    title: "Tangent: a slope in numbers…",
    group: "Keys",
    keys: ["Shift+V"],
    not: needsPoint,
    run: dialog("slope"),
  },
];
