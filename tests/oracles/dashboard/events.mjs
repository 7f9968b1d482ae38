// Holds the dashboard's stream of events against the server's own record while connections are dropped by force, and its memory
// and pace against long lists. Arguments: address of the server, number of drops. Prints one line of JSON with the figures.
import assert from "node:assert/strict";
import http from "node:http";
import { open } from "./browser.mjs";

const [server, drops] = [new URL(process.argv[2]), Number(process.argv[3])];
const streams = new Set();
const proxy = http.createServer((asked, answer) => {
  const isStream = asked.url.startsWith("/api/v1/events");
  const passed = http.request({ host: server.hostname, port: server.port, path: asked.url, method: asked.method,
    headers: { ...asked.headers, host: server.host } }, (from) => {
    answer.writeHead(from.statusCode, from.headers);
    from.pipe(answer);
  });
  passed.on("error", () => answer.destroy());
  if (isStream) {
    streams.add(answer);
    answer.on("close", () => { streams.delete(answer); passed.destroy(); });
  }
  asked.pipe(passed);
});
await new Promise((listening) => proxy.listen(0, "127.0.0.1", listening));
const base = `http://127.0.0.1:${proxy.address().port}/`;
const api = `${server.origin}/api/v1`;
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const post = async (path, body, type = "application/json") => {
  const answer = await fetch(`${api}${path}`, { method: "POST", headers: { "content-type": type }, body });
  assert.ok(answer.ok, `${path}: ${answer.status}`);
  return answer.json();
};

/** Ids of all events after one, from the server itself: to `last`, and those that come until it is silent. */
async function eventsAfter(id, last) {
  const abort = new AbortController();
  const response = await fetch(`${api}/events`, { headers: { "Last-Event-ID": id }, signal: abort.signal });
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let [text, reading] = ["", reader.read()];
  const ids = () => [...text.matchAll(/^id: ?(\d+)$/gm)].map(([, id]) => id);
  for (;;) {
    const next = await Promise.race([reading, pause(2000)]);
    if (next?.done || (!next && Number(ids().at(-1)) >= last)) break;
    if (!next) continue;
    text += next.value;
    reading = reader.read();
  }
  abort.abort();
  return ids();
}

const tetrahedron = `solid t\n${[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map((face) => {
  const corners = [[0, 0, 0], [40, 0, 0], [0, 40, 0], [0, 0, 40]];
  return `facet normal 0 0 0\nouter loop\n${face.map((at) => `vertex ${corners[at].join(" ")}`).join("\n")}\nendloop\nendfacet`;
}).join("\n")}\nendsolid t\n`;
const mesh = await post("/meshes?unit=mm&name=tetrahedron.stl", tetrahedron, "model/stl");
const quick = { candidates: { strategies: ["ellipsoid"], rolls_deg: [0], step_small_deg: 90, step_large_deg: 90 }, part: { patch_edge_mm: 20, samples_per_mm2: 0.01 },
  visibility: { engine: "rays" }, missed: { remedies: 0 }, selection: { max_views: 1 } };
const startJob = () => post("/jobs", JSON.stringify({ mesh_id: mesh.id, cell: "none", params: quick }));

const { browser, page } = await open(base);
// Requests for one job, which a progress event must not cause.
let asked = 0;
page.on("request", (request) => { asked += /\/api\/v1\/jobs\/[0-9a-f-]{36}$/.test(request.url()) ? 1 : 0; });
await page.goto(base);
await page.locator("#connection[data-connection=live]").waitFor();
await startJob();
await page.waitForFunction(() => window.vantage.seen.events.length > 0);
let dropped = 0;
let lost = 0;
for (let round = 0; dropped < drops; round += 1) {
  if (round % 3 === 0) await startJob();
  for (const stream of streams) { stream.destroy(); dropped += 1; }
  await pause(150 + (round % 5) * 60);
  lost += (await page.locator("#connection").getAttribute("data-connection")) === "lost" ? 1 : 0;
}
assert.ok(lost > 0, "the page says that the server is lost");
await page.locator("#connection[data-connection=live]").waitFor();
// A page that nobody sees holds no connection, and takes up what happened when it is seen.
const hide = (isHidden) => page.evaluate((isHidden) => {
  Object.defineProperty(document, "hidden", { configurable: true, get: () => isHidden });
  document.dispatchEvent(new Event("visibilitychange"));
}, isHidden);
await hide(true);
// Closing takes its time; none is opened once they are closed.
for (let waited = 0; streams.size > 0 && waited < 30_000; waited += 100) await pause(100);
await pause(1500);
assert.equal(streams.size, 0, "a hidden page holds no stream");
await startJob();
await hide(false);
await page.locator("#connection[data-connection=live]").waitFor();
const jobs = await (await fetch(`${api}/jobs?page_size=1000`)).json();
for (const { id } of jobs.items) while (["queued", "running"].includes((await (await fetch(`${api}/jobs/${id}?wait=60s`)).json()).state));
await pause(3000);
const [first, last] = (await page.evaluate(() => [window.vantage.seen.events[0], window.vantage.seen.events.at(-1)])).map(Number);
const wanted = await eventsAfter(String(first - 1), last);
// On a busy machine the last ones are still on their way, and the jobs that they are of.
await page.waitForFunction((count) => window.vantage.seen.events.length >= count, wanted.length);
const seen = await page.evaluate(() => window.vantage.seen.events);
assert.equal(new Set(seen).size, seen.length, "no event is handled twice");
assert.deepEqual(seen, wanted, "no event is lost, and all are in order");
await page.waitForFunction((count) => document.querySelectorAll(".job[data-state=succeeded]").length >= count, Math.min(jobs.items.length, 1000));
const shown = await page.locator(".job[data-state=succeeded]").count();
assert.equal(shown, Math.min(jobs.items.length, 1000), "the list is that of the server");

// An hour of events, ten a second, of a job whose row is drawn anew by each, leaves nothing behind.
const debug = await page.context().newCDPSession(page);
const heap = async () => {
  for (const _ of "123") await debug.send("HeapProfiler.collectGarbage");
  return (await debug.send("Runtime.getHeapUsage")).usedSize;
};
const feed = (id, count) => page.evaluate(async ({ count, id }) => {
  const drawn = new Set();
  for (let i = 0; i < count; i += 1) {
    window.vantage.applyEvent({ id: String(i), kind: "progress", data: { job_id: id, stage: "selection", fraction: (i % 100) / 100, state: "running" } });
    if (i % 130 === 0) {
      await new Promise(requestAnimationFrame);
      drawn.add(document.querySelector(`#job-${id} progress`)?.value);
    }
  }
  return drawn.size;
}, { count, id });
// One job that the page believes to run, which the server does not know: the end of one that has ended is final.
const known = "01b00000-0000-7000-8000-000000000000";
await page.evaluate((job) => { window.vantage.keepJob(job); }, { ...jobs.items[0], id: known, state: "running", ended_at: null, summary: null });
const drawn = await feed(known, 4000);
assert.ok(drawn > 3, `the row was drawn with ${drawn} different shares`);
const before = await heap();
await feed(known, 36_000);
const grown = (await heap()) - before;
assert.ok(grown < 2e6, `the heap grew by ${grown} bytes`);
asked = 0;
await feed("00000000-0000-7000-8000-000000000000", 20);
await pause(300);
assert.equal(asked, 0, "nothing is asked for a job that the page does not have");

// Five hundred jobs are listed without stutter.
const whole = (await (await fetch(`${api}/jobs?page_size=1`)).json()).items[0];
const many = Array.from({ length: 500 }, (_, i) => ({ ...whole, id: `01a20000-0000-7000-8000-${String(i).padStart(12, "0")}` }));
await page.route("**/api/v1/jobs?page_size=*", (route) => route.fulfill({ json: { items: many, next_page_token: null } }));
await page.reload();
await page.waitForFunction(() => document.querySelectorAll(".job").length >= 500);
// What the page itself does for a frame: scripts, styles and layout. Painting is done in software here, at the pace that the
// machine leaves.
await debug.send("Performance.enable");
const worked = async () => {
  const { metrics } = await debug.send("Performance.getMetrics");
  const secs = ["ScriptDuration", "LayoutDuration", "RecalcStyleDuration"].map((name) => metrics.find((metric) => metric.name === name).value);
  return 1000 * secs.reduce((sum, value) => sum + value, 0);
};
await pause(2000);
const begun = await worked();
const FRAMES = 60;
await page.evaluate(async (count) => {
  const main = document.getElementById("main");
  for (let i = 0; i < count; i += 1) {
    // A fast turn of the wheel.
    main.scrollTop += 120;
    await new Promise(requestAnimationFrame);
  }
}, FRAMES);
const work = (await worked()) - begun;
assert.ok(work / FRAMES < 33, `a frame of the list of 500 takes ${work / FRAMES} ms of scripts, styles and layout`);
// The list is as wide as the window, also where rows out of view were wider.
for (const width of [390, 1280]) {
  await page.setViewportSize({ width, height: 720 });
  await page.waitForFunction((width) => innerWidth === width, width);
  await pause(500);
  const [inner, outer] = await page.evaluate(() => [document.getElementById("main").scrollWidth, document.getElementById("main").clientWidth]);
  assert.ok(inner <= outer, `the list is ${inner} pixels wide in ${outer}`);
}
// A display on a wall runs for months: of jobs that come one by one, those that have ended do not stay for ever.
const later = Array.from({ length: 1001 }, (_, i) => ({ ...whole, id: `01a30000-0000-7000-8000-${String(i).padStart(12, "0")}` }));
const newest = later.slice(-100).reverse();
await page.unroute("**/api/v1/jobs?page_size=*");
await page.route("**/api/v1/jobs?page_size=*", (route) => route.fulfill({ json: { items: newest, next_page_token: null } }));
await page.evaluate((later) => later.forEach((job) => window.vantage.keepJob(job)), later);
await page.waitForFunction(() => document.querySelectorAll(".job").length === 100);
assert.equal(await page.locator(".job").first().getAttribute("id"), `job-${newest[0].id}`);
await browser.close();
proxy.close();
proxy.closeAllConnections();
console.log(JSON.stringify({ drops: dropped, events: seen.length, heap_growth_bytes: grown, work_ms_a_frame: work / FRAMES }));
