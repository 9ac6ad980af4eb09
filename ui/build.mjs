// Bundles src/ into dist/: one script, one style sheet, one page, the letters. Nothing is fetched
// from elsewhere at run time; the Rust binary embeds dist/.

import { copyFile, mkdir, readFile } from "node:fs/promises";
import { gzipSync } from "node:zlib";
import { build, context } from "esbuild";

const options = {
  entryPoints: { app: "src/main.tsx" },
  bundle: true,
  minify: !process.argv.includes("--watch"),
  sourcemap: false,
  target: "es2022",
  format: "esm",
  jsx: "automatic",
  jsxImportSource: "preact",
  outdir: "dist",
  loader: { ".woff2": "file" },
  assetNames: "[name]",
  legalComments: "eof",
  logLevel: "warning",
};

await mkdir("dist", { recursive: true });
await copyFile("src/index.html", "dist/index.html");
await copyFile("src/icon.svg", "dist/icon.svg");
// What is bundled with its terms: the letters and the signs.
await copyFile("node_modules/@fontsource-variable/inter/LICENSE", "dist/licence-inter.txt");
await copyFile("node_modules/lucide/LICENSE", "dist/licence-lucide.txt");

if (process.argv.includes("--watch")) {
  await (await context(options)).watch();
} else {
  await build(options);
  const sizes = await Promise.all(
    ["app.js", "app.css"].map(async (f) => gzipSync(await readFile(`dist/${f}`)).length),
  );
  console.error(`ui bundle: ${Math.round(sizes.reduce((a, b) => a + b) / 1024)} KiB gzip`);
}
