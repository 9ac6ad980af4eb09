// Runs src/**/*.test.ts with node's own test runner, on any node from 18 on.

import { spawnSync } from "node:child_process";
import { readdirSync } from "node:fs";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { build } from "esbuild";

const tests = readdirSync("src", { recursive: true }).filter((f) => f.endsWith(".test.ts"));
const out = await mkdtemp(join(tmpdir(), "robert-ui-"));
await build({
  entryPoints: tests.map((t) => join("src", t)),
  bundle: true,
  platform: "node",
  format: "esm",
  outdir: out,
  outExtension: { ".js": ".mjs" },
  logLevel: "warning",
});
const { status } = spawnSync(process.execPath, ["--test", out], { stdio: "inherit" });
await rm(out, { recursive: true });
process.exit(status ?? 1);
