// Who draws the 3D view, and whether the robot casts a shadow there.

import { signal } from "@preact/signals";
import { tell } from "./wire";

/** The name of what draws WebGL; undefined without it. Asked once: every probe holds a context, and a page
 * has only sixteen. */
export const DRAWS: string | undefined = ((): string | undefined => {
  try {
    const gl = document.createElement("canvas").getContext("webgl2");
    if (!gl) return undefined;
    const more = gl.getExtension("WEBGL_debug_renderer_info");
    const name = String(gl.getParameter(more ? more.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  } catch {
    return undefined;
  }
})();

/** Drivers that draw with the processor: shadows make them several times slower. */
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

const chosen = localStorage.getItem("shadows");

/** Where a graphics card draws, unless somebody has chosen. */
export const shadows = signal(chosen ? chosen === "on" : !SOFTWARE.test(DRAWS ?? "software"));

export function toggleShadows(): void {
  shadows.value = !shadows.value;
  localStorage.setItem("shadows", shadows.value ? "on" : "off");
  tell("view.show", { shadows: shadows.value });
}
