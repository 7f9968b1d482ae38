// Walks through the dashboard in a real browser as an operator does: upload, plan, inspect a missed spot, play, run in
// simulation, report; and holds what is drawn against what the API answers. Arguments: base address, folder for pictures, JSON of
// the parts `[{file, unit}]`. Prints one line of JSON with the figures reached; throws on the first thing that is wrong.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, join } from "node:path";
import { open } from "./browser.mjs";

const [base, pictures, parts] = [process.argv[2], process.argv[3], JSON.parse(process.argv[4])];
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const figures = { parts: [], requests: 0, axe: 0 };
const { browser, page, seen } = await open(base, { colorScheme: "light" });
const api = async (path) => (await fetch(`${base}api/v1${path}`)).json();
const picture = (name) => page.screenshot({ path: join(pictures, `${name}.png`) });
const UNITS = ["mm", "cm", "m", "inch"];
const SLOW = 180_000;
page.setDefaultTimeout(SLOW);

/** Faults of accessibility that are serious or worse, by the rules of WCAG 2 A and AA. */
async function check(name) {
  // The policy of the page lets no text run as script: axe comes in by the debugger.
  await page.evaluate(axe);
  const result = await page.evaluate(() => window.axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "best-practice"] }));
  const serious = result.violations.filter(({ impact }) => impact === "serious" || impact === "critical");
  assert.deepEqual(serious.map(({ id, nodes }) => [id, nodes.map(({ html }) => html.slice(0, 160))]), [], `axe on ${name}`);
  figures.axe += 1;
  await picture(name);
}

/** Presses Tab until an element that fits has the focus: what cannot be reached so cannot be used without a mouse. */
async function tabTo(selector, presses = 120) {
  for (let i = 0; i < presses; i += 1) {
    await page.keyboard.press("Tab");
    if (await page.evaluate((selector) => document.activeElement?.matches(selector) ?? false, selector)) {
      const outline = await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle);
      assert.notEqual(outline, "none", `the focus on ${selector} is seen`);
      return;
    }
  }
  throw new Error(`${selector} is not reached by ${presses} tabs`);
}

/** Chooses the file and the unit and starts; by the keyboard alone, but for the system's own dialog of files. */
async function start({ file, unit }) {
  await page.goto(base);
  await page.locator("#connection[data-connection=live]").waitFor();
  await tabTo('a[href="#/new"]');
  await page.keyboard.press("Enter");
  await page.locator("input[name=file]").setInputFiles(file);
  const chosen = page.locator("select[name=unit]");
  await chosen.waitFor();
  assert.equal(await chosen.inputValue(), "", "no unit is preset");
  assert.ok(await page.locator(".sticky button").isDisabled(), "nothing starts without a unit");
  await page.locator(".units tr").nth(3).waitFor();
  await tabTo("select[name=unit]");
  for (let i = -1; i < UNITS.indexOf(unit); i += 1) await page.keyboard.press("ArrowDown");
  assert.equal(await chosen.inputValue(), unit);
  // A part with an exact number of views is planned in seconds.
  await tabTo(".group:last-of-type > summary");
  await page.keyboard.press("Enter");
  await tabTo(".params input[type=search]");
  await page.keyboard.type("max_views");
  await tabTo('input[aria-label="selection.max_views"]');
  await page.keyboard.type("5");
  await page.waitForFunction(() => [...window.vantage.stages ?? []].some((stage) => stage.frames > 0));
  await check(`${basename(file)}-new`);
  await tabTo(".sticky button");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /#\/jobs\/[0-9a-f-]{36}/.test(location.hash));
  return (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0];
}

const sceneOf = () => page.evaluate(() => {
  const { scene, model } = window.vantage.plan;
  const of = (name) => scene.stage.scene.getObjectByName(name);
  return {
    triangles: of("part").geometry.attributes.position.count / 3, faces: model.mesh.faces, bytes: model.bytes.length,
    views: of("viewpoints").count, frustums: of("frustum").children.length, pins: of("pins").children.length, pixels: scene.stage.pixels(),
  };
});

async function inspect(id, file) {
  const plan = await api(`/jobs/${id}/plan`);
  await page.waitForFunction(() => window.vantage.plan?.scene.stage.frames > 0);
  const drawn = await sceneOf();
  assert.equal(drawn.triangles, drawn.faces);
  assert.equal(drawn.bytes, drawn.faces, "a byte a face");
  assert.equal(drawn.views, plan.viewpoints.length);
  assert.ok(drawn.pixels.drawn > 0.05 && drawn.pixels.colours > 5, JSON.stringify(drawn.pixels));
  await check(`${file}-plan`);
  // Legend: its areas are those of the faces.
  const shares = await page.locator(".legend td:last-child").allInnerTexts();
  assert.ok(Math.abs(shares.reduce((sum, text) => sum + parseFloat(text), 0) - 100) < 0.5, shares.join());
  // The largest missed spot, by the keyboard.
  const missed = await api(`/jobs/${id}/missed`);
  const largest = missed.missed.flatMap(({ reason, listing }) => listing.map((spot) => ({ reason, ...spot }))).sort((a, b) => b.area_mm2 - a.area_mm2)[0];
  await tabTo('.side [role=tab][aria-selected=true]');
  for (const _ of "12") await page.keyboard.press("ArrowRight");
  await tabTo(".spots button");
  await page.keyboard.press("Enter");
  const spot = page.locator(".spot [data-spot]");
  await spot.waitFor();
  assert.equal(await spot.getAttribute("data-spot"), largest.reason);
  assert.match(await page.locator(".spot").innerText(), /No view measures this spot/);
  if (largest.remedy) assert.ok((await page.locator(".remedy").innerText()).includes(largest.remedy.text), largest.remedy.text);
  // The spot is marked in the scene, with the next frame.
  await page.waitForFunction(() => window.vantage.plan.scene.stage.scene.getObjectByName("pins").children.length > 0);
  await picture(`${file}-spot`);
  const kept = await page.evaluate(() => location.hash);
  await page.reload();
  await spot.waitFor();
  assert.equal(await page.evaluate(() => location.hash), kept, "a reload keeps the place");
  return { plan, agreement: await agreement(), ...(await views()) };
}

/** Share of the area on which the browser's visibility and the planner's verdict are one: measured, or not. */
const agreement = () => page.evaluate(async () => {
  const { model, state } = window.vantage.plan;
  await state.score();
  const scores = state.scores.value;
  let [same, all] = [0, 0];
  model.bytes.forEach((byte, face) => {
    // Likely lost in a real scan, or not asked: the optics alone do not decide.
    if (byte === 36 || byte === 255 || byte === 16) return;
    all += model.mesh.areas[face];
    if ((byte < 16) === (scores.counts[face] > 0)) same += model.mesh.areas[face];
  });
  return same / all;
});

/** A view is chosen, dropped, and taken back: its frustum is drawn and the estimate falls. */
async function views() {
  await page.locator('.side [data-tab="views"]').click();
  await page.locator(".views button").first().click();
  await page.waitForFunction(() => window.vantage.plan.scene.stage.scene.getObjectByName("frustum").children.length === 1);
  await page.locator(".views input").first().click();
  const share = page.locator("#edited-share");
  await page.waitForFunction(() => /%/.test(document.querySelector("#edited-share")?.textContent ?? ""));
  await page.waitForFunction(() => window.vantage.plan.state.computing.value === null);
  const [before, after] = await page.evaluate(() => {
    const { plannedScores, scores } = window.vantage.plan.state;
    return [plannedScores.value, scores.value].map(({ measured, total }) => measured / total);
  });
  assert.ok(after < before - 0.01, `${before} to ${after}`);
  assert.match(await share.innerText(), /%/);
  return { dropped: before - after };
}

async function play(id) {
  await page.goto(`${base}#/jobs/${id}/cell`);
  await page.waitForFunction(() => window.vantage.cell?.scene.stage.frames > 0);
  const off = await page.evaluate(() => {
    const { scene, timeline } = window.vantage.cell;
    return timeline.spans.filter(({ op }) => op === "scan").map((span) => {
      const at = span.path.at(-1);
      scene.pose(at);
      return scene.offPlan(span.viewpoint, at).mm;
    });
  });
  assert.ok(off.length > 0 && Math.max(...off) < 0.1, `the scanner is where it was planned: ${off}`);
  const clock = () => page.locator('.player input[type="range"]').inputValue().then(Number);
  await tabTo(".player .primary");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.querySelector('.player input[type="range"]').valueAsNumber > 0.5);
  await page.keyboard.press("Enter");
  const stopped = await clock();
  await check("cell");
  const pixels = await page.evaluate(() => window.vantage.cell.scene.stage.pixels());
  assert.ok(pixels.drawn > 0.03, JSON.stringify(pixels));
  await page.reload();
  await page.waitForFunction(() => document.querySelector('.player input[type="range"]'));
  assert.ok(Math.abs((await clock()) - stopped) < 0.05, "a reload keeps the time");
  return Math.max(...off);
}

async function run() {
  await tabTo(".jobhead .primary");
  await page.keyboard.press("Enter");
  await page.locator("#run-state").waitFor();
  assert.match(await page.locator(".safety").innerText(), /not safety-rated/);
  await page.waitForFunction(() => (window.vantage.run?.samples.value.length ?? 0) > 3);
  await check("run");
  await page.locator("#run-state.done").waitFor();
  const id = (await page.evaluate(() => location.hash)).split("/")[2];
  const [{ coverage, steps, step }, samples] = [await api(`/runs/${id}?wait=60s`), await page.evaluate(() => window.vantage.run.samples.value.length)];
  assert.equal(step, steps);
  assert.ok(Math.abs(coverage.measured_of_asked - coverage.planned_of_asked) < 0.01);
  return samples;
}

for (const part of parts) {
  const file = basename(part.file);
  const id = await start(part);
  await page.locator(".jobhead .state:not(.queued):not(.running)").waitFor();
  const job = await api(`/jobs/${id}`);
  assert.equal(job.state, "succeeded", JSON.stringify(job.problem));
  const { agreement, dropped } = await inspect(id, file);
  assert.ok(agreement > 0.97, `visibility in the browser and in the plan: ${agreement}`);
  const off = await play(id);
  const samples = await run();
  const report = await fetch(`${base}api/v1/jobs/${id}/report`);
  assert.ok(report.ok && /^<!doctype html>/i.test(await report.text()));
  figures.parts.push({ file, views: job.summary.views, agreement, dropped, off_mm: off, samples });
}
for (const [name, hash] of Object.entries({ jobs: "#/jobs", runs: "#/runs", specs: "#/specs/scanners/transcan-c", robot: "#/specs/robots/ur5e" })) {
  await page.goto(base + hash);
  await page.waitForTimeout(1500);
  await check(name);
}
const two = (await api("/jobs?state=succeeded&page_size=2")).items.map(({ id }) => id);
if (two.length === 2) {
  await page.goto(`${base}#/compare/${two.join("/")}`);
  await page.waitForFunction(() => [...window.vantage.stages].filter((stage) => stage.frames > 0).length === 2);
  await check("compare");
}
await page.emulateMedia({ colorScheme: "dark" });
await page.goto(`${base}#/jobs`);
await check("jobs-dark");
assert.deepEqual(seen.errors, [], "the console");
assert.deepEqual(seen.foreign, [], "requests to elsewhere");
figures.requests = seen.requests;
await browser.close();
console.log(JSON.stringify(figures));
