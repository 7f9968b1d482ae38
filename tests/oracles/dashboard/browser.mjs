// A browser of Debian with 3D drawn in software, and what a page of it does: errors on the console, requests, to whom.
import { chromium } from "playwright-core";

export async function open(base, context = {}) {
  const browser = await chromium.launch({
    executablePath: process.env.VANTAGE_CHROMIUM,
    args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  });
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 720 }, ...context })).newPage();
  const seen = { errors: [], foreign: [], requests: 0 };
  page.on("console", (message) => { if (message.type() === "error") seen.errors.push(message.text()); });
  page.on("pageerror", (error) => seen.errors.push(String(error.stack)));
  page.on("request", (request) => {
    seen.requests += 1;
    const { protocol, origin } = new URL(request.url());
    if (protocol !== "blob:" && origin !== new URL(base).origin) seen.foreign.push(request.url());
  });
  return { browser, page, seen };
}
