// A browser of Debian with 3D drawn in software, and what a page of it does: errors on the console, requests, to whom. Where a script
// fails, or is ended for its time, it tells on which step, what the page shows and what its console says; the fault comes last.
import { chromium } from "playwright-core";

/** Time for one wait: tests beside it may have all cores, and what hangs is ended by who started the script. */
export const SLOW = 600_000;
const SHOWN = 1500;
const [begun, steps] = [Date.now(), []];
let opened = null;

/** Names what the script does from here on. */
export function step(name) {
  steps.push(`${((Date.now() - begun) / 1000).toFixed(1)} s: ${name}`);
}

const within = (ms, promise) => Promise.race([promise, new Promise((done) => { setTimeout(done, ms, "no answer"); })]).catch(String);

async function tell(error) {
  console.error(`steps: ${steps.slice(-12).join("\n  ")}`);
  if (opened) {
    const { page, seen, pictures } = opened;
    console.error(`console: ${seen.errors.join("\n  ").slice(-SHOWN) || "nothing"}`);
    console.error(`failed requests: ${seen.failed.slice(-10).join("\n  ") || "none"}`);
    console.error(`address: ${page.url()}`);
    console.error(`page: ${String(await within(10_000, page.evaluate(() => document.body.innerText))).slice(0, 2 * SHOWN)}`);
    if (pictures) await within(10_000, page.screenshot({ path: `${pictures}/failed.png` }));
  }
  console.error(`FAILED after ${((Date.now() - begun) / 1000).toFixed(0)} s at “${steps.at(-1) ?? "the start"}”: ${error?.stack ?? error}`);
}

let isTold = false;
async function fail(error) {
  if (isTold) return;
  isTold = true;
  await tell(error);
  if (opened) await within(10_000, opened.browser.close());
  process.exit(1);
}
process.on("uncaughtException", fail);
process.on("SIGTERM", () => void fail("ended from outside: it took too long"));

export async function open(base, context = {}, pictures = "") {
  const browser = await chromium.launch({
    executablePath: process.env.VANTAGE_CHROMIUM,
    timeout: SLOW,
    // The page is asked what it shows before the browser is closed.
    handleSIGTERM: false,
    // A busy machine is no card that hangs.
    args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-watchdog"],
  });
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 720 }, ...context })).newPage();
  page.setDefaultTimeout(SLOW);
  const seen = { errors: [], foreign: [], failed: [], requests: 0 };
  page.on("console", (message) => { if (message.type() === "error") seen.errors.push(`${message.text()} ${message.location().url ?? ""}`.trim()); });
  page.on("pageerror", (error) => seen.errors.push(String(error.stack)));
  page.on("crash", () => void fail("the page crashed"));
  page.on("requestfailed", (request) => seen.failed.push(`${request.method()} ${request.url()} ${request.failure()?.errorText}`));
  page.on("request", (request) => {
    seen.requests += 1;
    const { protocol, origin } = new URL(request.url());
    if (protocol !== "blob:" && origin !== new URL(base).origin) seen.foreign.push(request.url());
  });
  opened = { browser, page, seen, pictures };
  return { browser, page, seen };
}
