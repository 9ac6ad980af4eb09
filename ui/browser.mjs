// Runs browser/*.test.ts: real server, real headless Chromium, real models. One process, one
// test after the other: two browsers on two cores only wait for each other.
//
//   npm run browser                    all
//   npm run browser -- features        files whose name has this word
//
// ROBERT_BIN names the program, CHROMIUM the browser, ROBERT_SCREENSHOTS a folder for pictures.
import { build } from "esbuild";
import { mkdir, mkdtemp, rm } from "node:fs/promises";
import { join } from "node:path";
import { spawnSync } from "node:child_process";
import { readdirSync } from "node:fs";

const word = process.argv[2] ?? "";
const rest = process.argv.slice(3);
const files = readdirSync("browser").filter((f) => f.endsWith(".test.ts") && f.includes(word)).sort();
if (process.env.ROBERT_SCREENSHOTS) await mkdir(process.env.ROBERT_SCREENSHOTS, { recursive: true });
// Inside node_modules, so that the bundle finds playwright-core.
const out = await mkdtemp(join("node_modules", ".browser-"));
let status = 0;
for (const file of files) {
  const made = join(out, file.replace(/\.ts$/, ".mjs"));
  await build({ entryPoints: [join("browser", file)], bundle: true, platform: "node", format: "esm", outfile: made, external: ["playwright-core"], logLevel: "warning" });
  status ||= spawnSync(process.execPath, ["--test", "--test-reporter=spec", ...rest, made], { stdio: "inherit" }).status ?? 1;
}
await rm(out, { recursive: true });
process.exit(status);
