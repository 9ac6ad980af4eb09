// The page in a real browser: real server, real headless Chromium, real models.
//
//   npm run browser                    all tests
//   npm run browser -- hand            files whose name has this word
//   npm run browser -- -g "undo"       tests whose title has this word
//   npm run measure                    how fast the page draws, loads and follows a hand, printed
//   npm run pictures                   the page's pictures in docs/media, taken anew
//
// ROBERT_BIN names the program, CHROMIUM the browser, ROBERT_SCREENSHOTS a folder for pictures, ROBERT_PAGE a
// folder with a page that was built later than the program.
import { defineConfig } from "@playwright/test";

export default defineConfig({
  testDir: "browser",
  outputDir: "node_modules/.browser",
  // One page after the other: two browsers on two cores only wait for each other.
  workers: 1,
  fullyParallel: false,
  // A test that fails runs once more, alone in a fresh browser. One that passes then is called
  // flaky in the summary: it is a mistake in the page or in the test, and is to be found.
  retries: 1,
  timeout: 600_000,
  reporter: [["list"]],
  projects: [
    { name: "page", testMatch: "*.test.ts" },
    { name: "measure", testMatch: "*.measure.ts", retries: 0 },
    { name: "pictures", testMatch: "*.pictures.ts", retries: 0 },
  ],
});
