// Walks through the dashboard in a real browser as an operator does: upload, plan, inspect a missed spot, play, run in
// simulation, report, inspection of simulated scans, a part that is not found, a failed job, setups, comparison; and holds what is drawn against what the API
// answers. Arguments: base address, folder for pictures, JSON of the parts `[{file, unit}]`, the program that scans in simulation.
// Prints one line of JSON with the figures reached; throws on the first thing that is wrong.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { open, step } from "./browser.mjs";

const [base, pictures, parts, program] = [process.argv[2], process.argv[3], JSON.parse(process.argv[4]), process.argv[5]];
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const figures = { parts: [], requests: 0, axe: 0 };
// What pages look like and how they are read out does not depend on the path that they are served below.
const isAtRoot = new URL(base).pathname === "/";
const { browser, page, seen } = await open(base, { colorScheme: "light" }, pictures);
const api = async (path) => (await fetch(`${base}api/v1${path}`)).json();
const picture = (name) => page.screenshot({ path: join(pictures, `${name}.png`) });
const UNITS = ["mm", "cm", "m", "inch"];

/** Faults of accessibility that are serious or worse, by the rules of WCAG 2 A and AA; and headings that leave out a level. */
async function check(name) {
  step(`check of ${name}`);
  if (!isAtRoot) return;
  // The policy of the page lets no text run as script: axe comes in by the debugger.
  await page.evaluate(axe);
  const result = await page.evaluate(() => window.axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "best-practice"] }));
  const serious = result.violations.filter(({ id, impact }) => impact === "serious" || impact === "critical" || id === "heading-order");
  assert.deepEqual(serious.map(({ id, nodes }) => [id, nodes.map(({ html }) => html.slice(0, 160))]), [], `axe on ${name}`);
  figures.axe += 1;
  await picture(name);
}

/** Waits until what the page was told is drawn: effects run after a frame, on a busy machine much later than in it. */
const frames = () => page.evaluate(() => new Promise((drawn) => { requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(drawn))); }));

/** Waits until the view that the address names is read and drawn. */
async function settled() {
  await frames();
  await page.waitForFunction(() => !document.querySelector("#main .pending"));
  await frames();
}

/** Presses Tab until an element that fits has the focus: what cannot be reached so cannot be used without a mouse. It is waited for first,
 *  where it is read or made usable by an answer that is still on its way. */
async function tabTo(selector, presses = 120) {
  step(`tab to ${selector}`);
  await page.waitForFunction((selector) => [...document.querySelectorAll(selector)].some((element) => element.checkVisibility() && !element.matches(":disabled")), selector);
  for (let i = 0; i < presses; i += 1) {
    await page.keyboard.press("Tab");
    // In one look: the page may draw the element anew between two.
    const outline = await page.evaluate((selector) => (document.activeElement?.matches(selector) ? getComputedStyle(document.activeElement).outlineStyle : null), selector);
    if (outline !== null) return assert.notEqual(outline, "none", `the focus on ${selector} is seen`);
  }
  throw new Error(`${selector} is not reached by ${presses} tabs`);
}

/** Reloads the page once its address is written, which the page does at most every 150 ms; the address that it then had. */
async function reload() {
  step("reload");
  await frames();
  const kept = await page.evaluate(() => new Promise((written) => { setTimeout(() => written(location.hash), 200); }));
  await page.reload();
  return kept;
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
  const poses = await stand();
  // Its list comes with the document of the API.
  await page.locator(".create .params input[type=search]").waitFor({ state: "attached" });
  // A part with an exact number of views is planned in seconds.
  await tabTo(".group:last-of-type > summary");
  await page.keyboard.press("Enter");
  await tabTo(".params input[type=search]");
  await page.keyboard.type("max_views");
  await tabTo('input[aria-label="selection.max_views"]');
  // With five the forearm is at one station of the inch part as far from the flange, to 0.05 mm, as pairs are left out from.
  await page.keyboard.type("6");
  await page.waitForFunction(() => [...window.vantage.stages ?? []].some((stage) => stage.frames > 0));
  await check(`${basename(file)}-new`);
  await tabTo(".sticky button");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /#\/jobs\/[0-9a-f-]{36}/.test(location.hash));
  return { id: (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0], poses };
}

/** Whether a file fits in a unit is what the program says of it, also where the page once had a rule of its own: of a part that is wide
 *  but shorter than the plate, and of one that is just too small. */
async function suits() {
  const folder = mkdtempSync(join(tmpdir(), "suits-"));
  // Until the limits of a scanner are told, which are late here, those of the cell that was chosen before are not taken for them.
  const late = /\/api\/v1\/check$/;
  await page.route(late, (route) => {
    const wait = route.request().postDataJSON().cell === "none" ? 1000 : 0;
    setTimeout(() => void route.continue().catch(() => {}), wait);
  });
  try {
    for (const edges of [[400, 400, 6], [7, 6, 6]]) {
      const corners = [[0, 0, 0], ...edges.map((edge, axis) => [0, 1, 2].map((i) => (i === axis ? edge : 0)))];
      const facets = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map((face) =>
        `facet normal 0 0 0\nouter loop\n${face.map((at) => `vertex ${corners[at].join(" ")}`).join("\n")}\nendloop\nendfacet`);
      const file = join(folder, `${edges.join("x")}.stl`);
      writeFileSync(file, `solid t\n${facets.join("\n")}\nendsolid t\n`);
      for (const hardware of [["--cell", "e05-transcan"], ["--scanner", "transcan-c"]]) {
        await page.goto(`${base}#/new`);
        await page.locator("select[name=cell]").selectOption(hardware[0] === "--cell" ? hardware[1] : "none");
        await page.locator("input[name=file]").setInputFiles(file);
        // Until the server has told its limits, a unit is told as neither.
        await page.waitForFunction(() => [...document.querySelectorAll(".units td:last-child")].slice(0, 4).map((cell) => cell.textContent).join("").includes("fit"));
        const told = await page.locator(".units tr").evaluateAll((rows) => rows.slice(0, 4).map((row) => [row.querySelector("th").textContent, row.lastChild.textContent === "fits"]));
        const { readings } = JSON.parse(execFileSync(program, ["inspect", file, ...hardware, "--json"]));
        assert.deepEqual(told, readings.map(({ unit, fits }) => [unit, fits]), `${edges}, ${hardware}`);
        await anew();
      }
    }
  } finally {
    await page.unroute(late);
    rmSync(folder, { recursive: true, force: true });
  }
}

/** The ways in which the part can stand are offered; the first is tried, and the part left as its file has it. */
async function stand() {
  await tabTo(".placing > summary");
  await page.keyboard.press("Enter");
  await page.locator(".poses li").first().waitFor();
  await tabTo(".poses button");
  await page.keyboard.press("Enter");
  await page.locator('.poses button[aria-pressed="true"]').first().waitFor();
  // It stands on three corners or more, once it is drawn so.
  await page.waitForFunction(() => {
    const part = [...window.vantage.stages].map(({ scene }) => scene.getObjectByName("look")?.getObjectByName("part")).find(Boolean);
    if (!part) return false;
    const { elements: m } = part.matrix;
    const { array } = part.geometry.attributes.position;
    const heights = Array.from({ length: array.length / 3 }, (_, i) => m[2] * array[3 * i] + m[6] * array[3 * i + 1] + m[10] * array[3 * i + 2] + m[14]);
    const size = Math.max(...heights.slice(0, 1e5));
    return heights.filter((z) => z < 2e-3 * size).length >= 3;
  }, null, { polling: 200 });
  const count = await page.locator(".poses li").count();
  await page.locator(".placing .check input").focus();
  await page.keyboard.press("Space");
  await page.waitForFunction(() => document.querySelectorAll('.poses button[aria-pressed="true"]').length === 0);
  return count;
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
  const kept = await reload();
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
  await reload();
  await page.waitForFunction(() => window.vantage?.plan?.scene.stage.scene.getObjectByName("frustum")?.children.length === 1);
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
  await editsKept();
  return { dropped: before - after };
}

/** Views changed by hand and the section plane are in the address, and there again after a reload. */
async function editsKept() {
  await page.locator(".move input").first().fill("7");
  await page.locator(".overlaybar select").last().selectOption("z");
  await page.locator(".overlaybar input[type=range]").last().fill("0.4");
  const edited = () => page.evaluate(() => {
    const { state, scene } = window.vantage.plan;
    return { plane: scene.plane(), views: state.views.value.map(({ id, isUsed, move, pose }) => ({ id, isUsed, move, pose })) };
  });
  // The view is tilted by 7°.
  const isCut = () => window.vantage?.plan?.scene.section.at === 0.4 && /edit=\d+_[01]_7_.*section=z0\.4/.test(location.hash);
  await page.waitForFunction(isCut);
  const before = await edited();
  await reload();
  await page.waitForFunction(isCut);
  await page.waitForFunction(() => /%.*%/s.test(document.querySelector(".edited p")?.textContent ?? ""));
  assert.deepEqual(await edited(), before, "a reload keeps edited views and the section");
  await page.locator(".edited button", { hasText: "Undo" }).click();
  await page.waitForFunction(() => !location.hash.includes("edit="));
}

/** Causes of a group of the report's legend. */
const GROUPS = { "in shadow": /^shadow_/, "too oblique": /^(incidence_|below_grade$)/, "faces away": /^facing$/, "outside the image": /^frame_/,
  "outside the working depth": /^depth$/, "out of reach, in collision or hidden by the cell": /^(unreachable|collision|hidden_by_cell|no_path)$/,
  "rests on or faces the table, or enclosed": /^(excluded_resting|faces_table|enclosed)$/, "measurable, no view chosen for it": /^(not_chosen|at_risk)$/ };

/** Colours of the legends of a job's report, by what a legend of the page calls the same. */
async function reportColours(id) {
  const report = await (await fetch(`${base}api/v1/jobs/${id}/report`, { headers: { accept: "text/html" } })).text();
  const found = [...report.matchAll(/class="swatch" style="background:(#[0-9a-f]{6})"><\/span>([^<]+)/g)];
  const colours = new Map(found.map(([, colour, label]) => [label.replace(/\s[\d.]+ %.*/, ""), colour]));
  return (key) => {
    const group = Object.entries(GROUPS).find(([, causes]) => causes.test(key))?.[0];
    return colours.get({ missed: "Missed", measured: "Measured", not_asked: "Not asked for" }[key] ?? (group ? `Missed: ${group}` : `Grade ${key}`));
  };
}

/** Grades and causes have the same colours here and in the report. */
async function coloursAgree(of) {
  const rows = await page.locator(".legend tr").evaluateAll((rows) => rows.map((row) =>
    [row.dataset.key, getComputedStyle(row.querySelector(".swatch")).backgroundColor.match(/\d+/g).map(Number)]));
  const hex = (rgb) => `#${rgb.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
  const both = rows.filter(([key]) => of(key));
  assert.deepEqual(both.map(([key, rgb]) => [key, hex(rgb)]), both.map(([key]) => [key, of(key)]));
  assert.ok(both.length > 2, JSON.stringify(rows));
}

/** Every way to colour the part has a legend whose shares are those of the whole. */
async function colours(id) {
  const of = await reportColours(id);
  for (const mode of ["grade", "count", "incidence", "cause"]) {
    await page.goto(`${base}#/jobs/${id}/plan?colour=${mode}`);
    // The legend of the way before stands until the address is read.
    await page.waitForFunction((mode) => document.querySelector(".overlaybar select")?.value === mode, mode);
    await frames();
    await page.waitForFunction(() => window.vantage.plan?.state.computing.value === null && document.querySelectorAll(".legend tr").length > 1);
    const shares = await page.locator(".legend td:last-child").allInnerTexts();
    assert.ok(Math.abs(shares.reduce((sum, text) => sum + parseFloat(text), 0) - 100) < 0.6, `${mode}: ${shares}`);
    if (mode === "grade" || mode === "cause") await coloursAgree(of);
  }
}

/** A region is drawn with each tool, and a plan asked for that leaves it out; which is not waited for. */
async function regions(id) {
  await page.goto(`${base}#/jobs/${id}/plan?panel=regions`);
  // The view that was chosen before is further away.
  await reload();
  await page.waitForFunction(() => window.vantage?.plan?.scene.stage.frames > 0);
  const canvas = page.locator(".stage canvas").first();
  await page.waitForFunction(() => window.vantage.plan.state.computing.value === null);
  const marked = () => page.evaluate(() => window.vantage.plan.state.marked.value.size);
  for (const tool of ["brush", "box", "faces"]) {
    await page.locator(".drawing select").first().selectOption(tool);
    const { x, y, width, height } = await canvas.boundingBox();
    // The middle may be a hole of the part.
    for (let place = 0; place < 40 && (await marked()) === 0; place += 1) {
      await page.mouse.click(x + width * (0.4 + 0.05 * (place % 5)), y + height * (0.35 + 0.05 * Math.floor(place / 5)));
      await page.waitForTimeout(400);
    }
    assert.ok((await marked()) > 0, `${tool} marks faces`);
    await page.waitForFunction(() => !/^0\.0\s/.test(document.querySelector("#marked-area").innerText));
  }
  await picture("region");
  await page.locator(".drawing .primary").click();
  await page.waitForFunction((id) => /#\/jobs\/[0-9a-f-]{36}/.test(location.hash) && !location.hash.includes(id), id);
  const next = (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0];
  const { params } = await api(`/jobs/${next}`);
  assert.equal(params.regions.exclude.length, 1, JSON.stringify(params.regions));
  await fetch(`${base}api/v1/jobs/${next}/cancel`, { method: "POST" });
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
  const gaps = await clearances(await api(`/jobs/${id}/plan`));
  const clock = () => page.locator('.player input[type="range"]').inputValue().then(Number);
  await tabTo(".player .primary");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.querySelector('.player input[type="range"]').valueAsNumber > 0.5);
  await page.keyboard.press("Enter");
  // A frame may be under way; the address has the time at which playback rests.
  await page.waitForFunction(() => /[?&]t=/.test(location.hash));
  const stopped = await clock();
  await check("cell");
  const pixels = await page.evaluate(() => window.vantage.cell.scene.stage.pixels());
  assert.ok(pixels.drawn > 0.03, JSON.stringify(pixels));
  await reload();
  await page.waitForFunction(() => document.querySelector('.player input[type="range"]'));
  assert.ok(Math.abs((await clock()) - stopped) < 0.05, "a reload keeps the time");
  return { off: Math.max(...off), gaps };
}

/** Largest difference between the page's distance of the nearest bodies and the plan's, of the views; mm. */
async function clearances(plan) {
  await page.locator("#clearance .chart").waitFor();
  const found = await page.evaluate(async () => {
    const scans = window.vantage.cell.timeline.spans.filter(({ op }) => op === "scan");
    const gaps = await window.vantage.clearanceAt(scans.map(({ path }) => path.at(-1)));
    return scans.map(({ viewpoint }, i) => [viewpoint, gaps[i]?.mm ?? null]);
  });
  const planned = (viewpoint) => plan.viewpoints.find(({ id }) => id === viewpoint).station.clearance_mm ?? null;
  assert.ok(found.every(([viewpoint, mm]) => (mm === null) === (planned(viewpoint) === null)), JSON.stringify(found));
  return Math.max(0, ...found.filter(([, mm]) => mm !== null).map(([viewpoint, mm]) => Math.abs(mm - planned(viewpoint))));
}

/** Files of a simulated scanner with limits that the plan does not know; nobody keeps them after `use`. */
async function scanned(id, { file, unit }, use) {
  const folder = mkdtempSync(join(tmpdir(), "scans-"));
  try {
    writeFileSync(join(folder, "plan.json"), JSON.stringify(await api(`/jobs/${id}/plan`)));
    const faults = ["step_px=8", "grazing_deg=[55,70]", "lobe_deg=4", "view_error_mm=0.1", "part_error_mm=0.3"].flatMap((fault) => ["--set", fault]);
    execFileSync(program, ["sim", "scanner", "plan.json", "--mesh", file, "--unit", unit, ...faults, "--out", "scans", "--quiet"], { cwd: folder });
    const scans = join(folder, "scans");
    return await use(readdirSync(scans).filter((name) => name.endsWith(".ply")).sort().map((name) => join(scans, name)));
  } finally {
    rmSync(folder, { recursive: true, force: true });
  }
}

/** Uploads through the page; the first file's view is chosen by hand, the others' are in their names. */
async function uploadScans(id, files) {
  await page.goto(`${base}#/jobs/${id}/inspection`);
  await page.locator("input[name=scans]").setInputFiles(files);
  const chosen = page.locator(".entry select").first();
  await chosen.selectOption({ index: 1 });
  const view = Number(await chosen.inputValue());
  await tabTo(".send", 200);
  await page.keyboard.press("Enter");
  await page.locator("#scans tbody tr").nth(files.length - 1).waitFor();
  const { items } = await api(`/jobs/${id}/scans`);
  assert.deepEqual(items.map(({ name, view }) => [name, view]), files.map((file, i) => [basename(file), i === 0 ? view : null]));
}

async function startInspection() {
  await tabTo(".inspect", 200);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /#\/inspections\/[0-9a-f-]{36}/.test(location.hash));
  const id = (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0];
  await page.locator(".inspection[data-state=succeeded] #verdict, .inspection[data-state=failed]").waitFor();
  const { state, problem } = await api(`/inspections/${id}`);
  assert.equal(state, "succeeded", JSON.stringify(problem));
  return id;
}

/** A share as the server's sentences have it: above 0 not as that, below all not as all. */
function percent(share) {
  const value = 100 * share;
  const shown = value.toFixed(2);
  if (share > 1e-9 && shown === "0.00") return `${value.toFixed(1 - Math.floor(Math.log10(value)))}\u00a0%`;
  return `${share < 1 - 1e-9 && shown === "100.00" ? "99.99" : shown}\u00a0%`;
}
const inspectionMap = () => page.waitForFunction(() => window.vantage.inspection?.scene?.stage.frames > 0);

/** Figures and maps of an inspection are those of the server; a face, a spot and the scale answer; everything is kept by the address. */
async function inspection(id) {
  const { coverage, losses } = await api(`/inspections/${id}/result`);
  const shown = Object.fromEntries(await page.locator("#verdict [data-figure]").evaluateAll((all) => all.map((one) => [one.dataset.figure, one.querySelector("strong").textContent])));
  assert.deepEqual([shown.planned, shown.measured, shown.lost, shown.gained], [coverage.planned_of_asked, coverage.measured_of_asked, coverage.lost_of_asked, coverage.gained_of_asked].map(percent));
  assert.ok(Math.abs(Number(shown.difference.replace("−", "-")) - 100 * (coverage.measured_of_asked - coverage.planned_of_asked)) < 0.0051, shown.difference);
  assert.deepEqual(await page.locator(".losses [data-cause]").evaluateAll((all) => all.map((one) => [one.dataset.cause, one.querySelector(".number").textContent])),
    losses.map(({ cause, of_asked: share }) => [cause, percent(share)]));
  await inspectionMap();
  await check("inspection");
  const colours = {};
  for (const map of ["coverage", "deviation", "losses"]) {
    await page.locator("select[name=map]").selectOption(map);
    await page.locator(map === "coverage" ? ".legend [data-key=both]" : map === "deviation" ? ".legend [data-key=step3]" : `.legend [data-key=${losses[0].cause}]`).waitFor();
    await page.waitForTimeout(300);
    await frames();
    const shares = await page.locator(".mapped .legend td:last-child").allInnerTexts();
    // The losses overlap with nothing; what is measured and not planned counts as measured.
    assert.ok(Math.abs(shares.reduce((sum, text) => sum + parseFloat(text), 0) - 100) < 0.6, `${map}: ${shares}`);
    const pixels = await page.evaluate(() => window.vantage.inspection.scene.stage.pixels());
    assert.ok(pixels.drawn > 0.03 && pixels.colours > 4, `${map}: ${JSON.stringify(pixels)}`);
    colours[map] = pixels.colours;
    await picture(`inspection-${map}`);
  }
  // The faces have the areas of the server's figures, but for the corners of what a preview leaves out.
  const off = await page.evaluate(() => {
    const { map } = window.vantage.inspection;
    const sum = (values) => values.reduce((total, value) => total + value, 0);
    return [sum(map.measured) / sum(map.asked), sum(map.planned) / sum(map.asked), sum(map.lost) / sum(map.asked)];
  });
  [coverage.measured_of_asked, coverage.planned_of_asked, coverage.lost_of_asked].forEach((share, i) => assert.ok(Math.abs(share - off[i]) < 0.01, `${share} and ${off[i]} of the faces`));
  await tabTo(".mapped .stage canvas", 300);
  // The middle may be a hole of the part.
  let match = null;
  for (const [way, timeout] of [...["", "ArrowLeft", "ArrowUp", "ArrowUp", "ArrowUp", "ArrowLeft", "ArrowLeft"].map((way) => [way, 4000]), [""]]) {
    if (way) await page.keyboard.press(way);
    await page.keyboard.press("Enter");
    // Taken at once: the answer to the next press may be a hole. The last press has all the time.
    const face = page.waitForFunction(() => document.querySelector("#face")?.dataset.match, null, { timeout });
    match = await face.then((found) => found.jsonValue(), () => null);
    if (match) break;
  }
  assert.ok(match, "a face says what it is");
  await page.locator(".losses summary").first().click();
  await page.locator(".losses details[open] .spots button").first().click();
  await page.waitForFunction(() => window.vantage.inspection.scene.stage.scene.getObjectByName("pins").children.length > 0);
  await page.locator("select[name=map]").selectOption("deviation");
  const kept = await reload();
  await inspectionMap();
  assert.equal(await page.evaluate(() => location.hash), kept);
  assert.equal(await page.locator("select[name=map]").inputValue(), "deviation", "a reload keeps the map");
  for (const href of await page.locator('.inspection a[href*="/api/v1/inspections/"]').evaluateAll((all) => all.map((link) => link.href))) {
    assert.ok((await fetch(href, { method: "HEAD" })).ok, href);
  }
  return { coverage, losses, colours };
}

/** Simulated scans are uploaded and inspected, further views planned, scanned and inspected; one scan is missing at first. */
async function inspectScans(id, part) {
  const first = await scanned(id, part, async (files) => {
    await uploadScans(id, files);
    await check("scans");
    await page.locator("#scans tbody tr").last().locator("button").click();
    await confirm();
    await page.waitForFunction((count) => document.querySelectorAll("#scans tbody tr").length === count, files.length - 1);
    return startInspection();
  });
  const { coverage, losses, colours } = await inspection(first);
  assert.ok(losses.some(({ cause }) => cause === "view_missing"), JSON.stringify(losses.map(({ cause }) => cause)));
  const offered = page.locator('.offers a[href*="#/new"], a[href*="set="]');
  // What the scans teach is read after the rest.
  await page.locator('table[aria-label="Estimates"]').waitFor();
  if ((await offered.count()) > 0) {
    const { parameter, to } = (await api(`/inspections/${first}/learned`)).offers.find(({ parameter }) => parameter);
    await offered.first().click();
    await page.locator(".create [role=status] code").first().waitFor();
    assert.equal((await page.locator(".create [role=status] code").first().innerText()).trim(), `${parameter} = ${to}`);
    await page.goto(`${base}#/inspections/${first}`);
  }
  await page.locator("input[name=max_views]").fill("2");
  await tabTo(".rescan .primary", 200);
  await page.keyboard.press("Enter");
  const made = page.locator(".rescan .made a").first();
  await made.waitFor();
  const further = (await made.getAttribute("href")).split("/")[2];
  const job = await jobEnded(further);
  assert.deepEqual([job.state, job.labels.rescan_of], ["succeeded", first], JSON.stringify(job.problem));
  await ofOpen(further, job.summary);
  const second = await scanned(further, part, async (files) => {
    assert.ok(files.length <= 2);
    await uploadScans(further, files);
    return startInspection();
  });
  await page.locator("#rounds").waitFor();
  const after = (await api(`/inspections/${second}/result`)).coverage;
  const cells = await page.locator("#rounds tbody tr").first().locator("td").allInnerTexts();
  assert.deepEqual(cells.slice(0, 2), [coverage.measured_in_all_of_asked, after.measured_in_all_of_asked].map(percent));
  assert.ok(after.measured_in_all_of_asked > coverage.measured_in_all_of_asked + 0.01, "further views measure more");
  await page.waitForFunction(() => [...window.vantage.stages].filter((stage) => stage.frames > 0).length === 3);
  await check("rounds");
  return { first, second, before: coverage.measured_in_all_of_asked, after: after.measured_in_all_of_asked, colours };
}

/** Shares of further views are of what earlier scans left open, and named so; the cycle is that of the robot's program. */
async function ofOpen(id, { of_open: isOpen, cycle_secs: planned, program_cycle: program }) {
  assert.ok(isOpen && Math.abs(program.cycle_secs - planned) > 1, JSON.stringify(program));
  await page.goto(`${base}#/jobs`);
  const row = page.locator(`#job-${id} .figures`);
  await row.waitFor();
  assert.match(await row.innerText(), /of open area\s[\d.]+\ss\s+robot program cycle time/);
  await page.goto(`${base}#/jobs/${id}/plan`);
  assert.match(await page.locator(".shares").innerText(), /measured of open, independent\s+open: asked area that earlier scans left open/);
  await page.locator(".legend [data-key=not_asked]", { hasText: "measured by earlier scans" }).waitFor();
}

/** Of a part that was not found, no deviation is shown as if it were one. The page is told so of scans that fit; of an earlier release, in
 *  other words. */
async function notFound(id) {
  const result = await api(`/inspections/${id}/result`);
  const { not_found: _, ...earlier } = { ...result.alignment, inlier_share: 0.373 };
  for (const alignment of [{ ...earlier, not_found: "few_inliers" }, earlier]) {
    await page.route(new RegExp(`/inspections/${id}/result$`), (route) => route.fulfill({ json: { ...result, alignment } }));
    await page.goto(`${base}#/inspections`);
    await page.locator("#inspections-title").waitFor();
    await page.goto(`${base}#/inspections/${id}?map=deviation`);
    assert.match(await page.locator("#not-found[data-reason=few_inliers]").innerText(), /not found in the scans: only 37\.3\s%/);
    await page.locator("select[name=map]").waitFor();
    assert.deepEqual(await page.locator("select[name=map] option").evaluateAll((all) => all.map(({ value }) => value)), ["losses", "coverage"]);
    assert.equal(await page.locator("select[name=map]").inputValue(), "losses");
    for (const shown of ["#verdict [data-figure=rms]", ".percentiles", "[data-verdict]", ".offers"]) assert.equal(await page.locator(`.inspection ${shown}`).count(), 0, shown);
    assert.ok(await page.locator(".rescan .primary").isDisabled(), "no further views are offered");
    await page.unrouteAll();
  }
  await settled();
  await check("not-found");
}

/** Of a list that is longer than a page the newest are shown, and older ones when they are asked for. The page is told of as many runs. */
async function older() {
  const [run] = (await api("/runs?page_size=1")).items;
  const all = Array.from({ length: 240 }, (_, i) => ({ ...run, id: `${run.id.slice(0, -3)}${String(i).padStart(3, "0")}` }));
  await page.route(/\/api\/v1\/runs\?/, (route) => {
    const asked = new URL(route.request().url()).searchParams;
    const from = Number(asked.get("page_token") ?? 0);
    const to = from + Number(asked.get("page_size"));
    return route.fulfill({ json: { items: all.slice(from, to), next_page_token: to < all.length ? String(to) : null } });
  });
  await page.goto(`${base}#/runs`);
  const isListed = (count) => page.waitForFunction((count) => document.querySelectorAll(".runs tbody tr").length === count, count);
  for (const count of [100, 200]) {
    await isListed(count);
    assert.match(await page.locator(".cut").innerText(), new RegExp(`^The newest ${count} are listed`));
    await press("Show older ones");
  }
  await isListed(all.length);
  assert.equal(await page.locator(".cut").count(), 0);
  await page.unrouteAll();
  const jobs = /\/api\/v1\/jobs\?page_size=\d+$/;
  await page.route(jobs, async (route) => {
    const response = await route.fetch();
    await route.fulfill({ response, json: { ...await response.json(), next_page_token: "more" } });
  });
  await page.goto(`${base}#/jobs`);
  await page.reload();
  await page.locator("#listed", { hasText: /^The newest \d+ are listed/ }).waitFor();
  await page.unrouteAll({ behavior: "wait" });
}

/** A calibration from a file of observations, by the keyboard but for the system's own dialog of files. */
async function calibrate() {
  const request = (await api("/openapi.json")).paths["/api/v1/calibrations"].post.requestBody.content["application/json"].example;
  await page.goto(`${base}#/calibrations`);
  await tabTo(".calibrations summary");
  await page.keyboard.press("Enter");
  await page.locator("input[name=observations]").setInputFiles({ name: "observations.json", mimeType: "application/json", buffer: Buffer.from(JSON.stringify(request.data)) });
  await tabTo(".calibrations .group .primary");
  await check("calibrations");
  await page.keyboard.press("Enter");
  const done = page.locator(".calibration[data-state=succeeded] .observations tbody tr");
  await done.first().waitFor();
  assert.equal(await done.count(), request.data.observations.length);
  assert.match(await page.locator("#verdict").innerText(), /A scanned point is known to [0-9.e-]+\smm/);
  // Charts are drawn after the table.
  await page.locator(".calibration .chart canvas").nth(3).waitFor();
  assert.equal(await page.locator(".calibration .chart canvas").count(), 4);
  const kept = await reload();
  await done.first().waitFor();
  assert.equal(await page.evaluate(() => location.hash), kept, "a reload keeps the calibration");
  await check("calibration");
  const report = await fetch(`${base}api/v1/calibrations/${kept.split("/")[2]}/report`);
  assert.ok(report.ok && /^<!doctype html>/i.test(await report.text()));
  await adopt(kept.split("/")[2]);
  return kept;
}

/** Leaves out of the console's errors those that the browser writes of answers with a status that is meant, or of none. */
function forget(status) {
  const meant = seen.errors.filter((text) => text.includes(status === null ? "net::ERR_" : `status of ${status}`));
  assert.ok(meant.length > 0, `${status} is answered`);
  seen.errors = seen.errors.filter((text) => !meant.includes(text));
}

/** The calibrated cell is stored under the name that the server gives it, and in place of what has the name only if one says so. */
async function adopt(id) {
  const { name } = await api(`/calibrations/${id}/cell`);
  const etag = async () => (await fetch(`${base}api/v1/cells/${name}`)).headers.get("etag");
  const link = page.getByRole("link", { name: "Stored: open it" });
  await page.waitForFunction((name) => document.querySelector("input[name=adopt]")?.value === name, name);
  await press("Store the cell");
  await link.waitFor();
  const first = await etag();
  await reload();
  await press("Store the cell");
  await page.locator("dialog").waitFor();
  await check("adopt");
  assert.equal(await etag(), first, "nothing is replaced before one says so");
  await press("Replace");
  await link.waitFor();
  assert.notEqual(await etag(), first);
  forget(428);
}

/** A specification that somebody else stored after the form was filled is not overwritten; one's own versions follow each other. */
async function versions() {
  const path = `${base}api/v1/scanners/walked`;
  const spec = { ...(await api("/scanners/transcan-c")), name: "walked" };
  const store = async (spec, headers) => {
    const answer = await fetch(path, { method: "PUT", headers: { "content-type": "application/json", ...headers }, body: JSON.stringify(spec) });
    assert.ok(answer.ok, await answer.clone().text());
    return answer.headers.get("etag");
  };
  const tag = await store(spec, {});
  const saved = page.locator(".editor [role=status]", { hasText: "Saved." });
  await page.goto(`${base}#/specs/scanners/walked`);
  await page.locator("#check[data-sound=true]").waitFor();
  const theirs = await store({ ...spec, depth_mm: { ...spec.depth_mm, far: spec.depth_mm.far - 1 } }, { "If-Match": tag });
  await press("Save");
  await page.locator("#message", { hasText: "another version" }).waitFor();
  assert.equal((await fetch(path)).headers.get("etag"), theirs, "what others stored stays");
  forget(412);
  await reload();
  for (let turn = 0; turn < 2; turn += 1) {
    await page.locator("#check[data-sound=true]").waitFor();
    const before = (await fetch(path)).headers.get("etag");
    await press("Save");
    await saved.waitFor();
    await page.waitForFunction(async ([path, before]) => (await fetch(path)).headers.get("etag") !== before, [path, before], { polling: 200 });
    await page.getByRole("button", { name: "Save", exact: true, disabled: false }).waitFor();
  }
  const name = page.getByLabel("Save as", { exact: true });
  await name.fill("walked-on");
  await saved.waitFor({ state: "detached" });
  await name.fill("walked");
  assert.equal((await api("/scanners/walked")).depth_mm.far, spec.depth_mm.far - 1);
  await press("Delete");
  await confirm();
  await page.waitForFunction(() => !location.hash.includes("walked"));
}

/** Cameras whose poses follow from a board are drawn where the plan has them. */
async function rig(plan) {
  await page.goto(`${base}#/specs/scanners/transcan-c`);
  await page.waitForFunction(() => window.vantage.spec?.devices.length === 3);
  const devices = await page.evaluate(() => window.vantage.spec.devices);
  return Math.max(...plan.scanner.devices.map(({ name, scanner_from_device: planned }) => {
    const { scanner_from_device: drawn } = devices.find((device) => device.name === name);
    return Math.hypot(...planned.translation_mm.map((value, i) => value - drawn.translation_mm[i]));
  }));
}

/** Directions from which the page finds a cube of 300 mm reached; the study's figure stands in config/cells/REACH.md. */
async function reach() {
  await page.goto(`${base}#/specs/cells/e05-transcan`);
  await tabTo(".reach > summary", 400);
  await page.keyboard.press("Enter");
  await page.locator('.reach input[type="range"]').fill("300");
  await tabTo(".reach .primary");
  await page.keyboard.press("Enter");
  await page.locator(".reach[data-directions]").waitFor();
  await check("reach");
  const [elevations, directions, colours] = await page.evaluate(() => {
    const { dataset } = document.querySelector(".reach");
    const dome = [...window.vantage.stages][0].scene.getObjectByName("reach");
    return [Number(dataset.elevations), Number(dataset.directions), new Set(dome.geometry.attributes.color.array).size];
  });
  assert.ok(colours > 2, "the dome is coloured");
  return { elevations, directions };
}

/** What cannot be read is told in the server's words, or that it does not answer, and read once more when the reader asks for it. */
async function unread() {
  const detail = "The database is locked by a backup.";
  const busy = (route) => route.fulfill({ status: 503, contentType: "application/problem+json", json: { type: "about:blank", title: "Unavailable", code: "unavailable", detail } });
  const again = page.locator(".problem", { hasText: detail }).getByRole("button", { name: "Try again" });
  const head = () => page.waitForFunction(() => document.activeElement?.matches("#main h1"));
  for (const [path, hash, rows] of [["jobs", "#/jobs", "#jobs > li"], ["inspections", "#/inspections", ".runs tbody tr"], ["calibrations", "#/calibrations", ".runs tbody tr"]]) {
    step(`unread ${path}`);
    await page.route(new RegExp(`/api/v1/${path}\\?`), busy);
    await page.goto(base + hash);
    await page.reload();
    await again.waitFor();
    assert.equal(await page.locator("#main .pending").count(), 0, "nothing is said to be loading");
    await page.unrouteAll();
    await again.focus();
    await page.keyboard.press("Enter");
    await page.locator(rows).first().waitFor();
    // An event may bring a row before the list is read again, which takes the problem away.
    await again.waitFor({ state: "detached" });
    await head();
    forget(503);
  }
  step("a server that does not answer");
  await page.goto(`${base}#/jobs`);
  await page.route(/\/api\/v1\//, (route) => route.abort());
  await page.reload();
  await page.locator("#main .problem", { hasText: "The server is not responding" }).waitFor();
  await page.unrouteAll();
  await page.locator("#jobs > li").first().waitFor();
  // An event may bring a row before the list is read again, which takes the problem away.
  await page.locator("#main > section > .problem").waitFor({ state: "detached" });
  step("a list that is read, and an earlier attempt that fails after it");
  const events = /\/api\/v1\/events/;
  await page.route(events, (route) => route.abort());
  const attempts = [];
  await page.route(/\/api\/v1\/jobs\?page_size=\d+$/, (route) => { if (attempts.push(route) > 1) void route.continue(); });
  await page.reload();
  while (attempts.length === 0) await frames();
  await page.unroute(events);
  await page.locator("#jobs > li").first().waitFor();
  // The page has its failure, and the console what is forgotten below.
  await Promise.all([page.waitForEvent("requestfailed", (request) => request === attempts[0].request()), attempts[0].abort()]);
  await frames();
  assert.equal(await page.locator("#main > section > .problem").count(), 0, "the list is there");
  await page.unrouteAll();
  forget(null);
  step("names that cannot be read");
  // Names come after the rows, which are named by their ids until then.
  await page.waitForFunction(() => {
    const part = document.querySelector("#jobs .part");
    return part && !part.closest("li").id.startsWith(`job-${part.textContent}`);
  });
  const name = await page.locator("#jobs .part").first().innerText();
  await page.route(/\/api\/v1\/meshes\/[0-9a-f-]{36}$/, busy);
  await page.reload();
  await page.locator("#unnamed", { hasText: detail }).waitFor();
  await page.locator("#jobs .part").first().waitFor();
  assert.notEqual(await page.locator("#jobs .part").first().innerText(), name);
  await page.unrouteAll();
  await page.locator("#unnamed button").click();
  await page.locator("#unnamed").waitFor({ state: "detached" });
  assert.equal(await page.locator("#jobs .part").first().innerText(), name);
  forget(503);
}

/** After something was deleted, the keyboard is at the next row, or at the heading where there is none; the filter stays. */
async function focusAfterDeletion({ mesh }) {
  const part = { table_from_part: { translation_mm: [0, 0, 10], rpy_deg: [0, 0, 0] } };
  for (let i = 0; i < 3; i += 1) await ended({ mesh_id: mesh.id, cell: "e05-transcan", params: { part }, labels: { walk: "focus" } });
  // The answer with the filter is on its way until the first of them is deleted: it must not bring that back.
  const listed = /\/api\/v1\/jobs\?page_size=\d+&label=/;
  let [answer, deliver] = [];
  const answered = new Promise((done) => { answer = done; });
  const delivered = new Promise((done) => { deliver = done; });
  await page.route(listed, async (route) => {
    const response = await route.fetch();
    answer();
    await delivered;
    await route.fulfill({ response });
  });
  await page.goto(`${base}#/jobs?q=walk%3Dfocus`);
  // An ended job can be deleted.
  const rows = page.locator("#jobs > li[data-state=failed]");
  await rows.nth(2).waitFor();
  await answered;
  const ids = await rows.evaluateAll((all) => all.map(({ id }) => id));
  // The row after the one that is deleted; of the last one, the row before it.
  for (const [deleted, next] of [[ids[0], ids[1]], [ids[2], ids[1]]]) {
    await tabTo(`#${deleted} .actions > button:last-of-type`, 300);
    await page.keyboard.press("Enter");
    await tabTo("dialog .danger");
    await page.keyboard.press("Enter");
    step("the row is gone, and the next one has the keyboard");
    await page.locator(`#${deleted}`).waitFor({ state: "detached" });
    await page.waitForFunction((next) => document.activeElement?.closest("li")?.id === next, next);
    assert.match(await page.evaluate(() => location.hash), /focus/, "the filter stays");
    const arrived = deleted === ids[0] && page.waitForResponse(listed);
    deliver();
    await arrived;
    await settled();
    assert.equal(await page.locator(`#${deleted}`).count(), 0, "an answer from before the deletion does not bring the row back");
  }
  await page.unrouteAll({ behavior: "wait" });
  await page.locator(`#${ids[1]} input[type=checkbox]`).check();
  await page.locator(".jobs > .actions button").focus();
  await page.keyboard.press("Enter");
  await confirm();
  await rows.first().waitFor({ state: "detached" });
  await page.waitForFunction(() => document.activeElement?.id === "jobs-title");
}

/** Times are shown with the zone that they are in. */
async function zones(rooms) {
  const zone = await page.evaluate(() => new Intl.DateTimeFormat().resolvedOptions().timeZone);
  for (const hash of rooms) {
    await page.goto(base + hash);
    await page.locator("#main", { hasText: zone }).waitFor();
  }
}

/** Tools above a view in three dimensions that something else covers, once they are scrolled to. */
const covered = () => page.evaluate(() => [...document.querySelectorAll(".toolbar button, .overlaybar select, .overlaybar input")].filter((tool) => {
  tool.scrollIntoView({ block: "center" });
  const { x, y, width, height } = tool.getBoundingClientRect();
  return !tool.contains(document.elementFromPoint(x + width / 2, y + height / 2));
}).map(({ outerHTML }) => outerHTML.slice(0, 120)));

/** Nothing is cut off at the sides, on a small screen, on a tablet held either way and on phones; no tool is covered. */
async function fits(rooms) {
  for (const [width, height] of [[1280, 720], [1024, 768], [768, 1024], [414, 896], [360, 640]]) {
    await page.setViewportSize({ width, height });
    for (const [name, hash] of Object.entries(rooms)) {
      await page.goto(base + hash);
      await settled();
      await page.waitForTimeout(700);
      const cut = await page.evaluate(() => {
        const [page, main] = [document.documentElement, document.getElementById("main")];
        const beyond = [...document.querySelectorAll("button, a, input, select, h1, h2, td, th, p")].filter((element) => {
          const { width, left, right } = element.getBoundingClientRect();
          return width > 0 && left < page.clientWidth && right > page.clientWidth + 1 && !element.closest(".scroll, .hidden, .skip");
        });
        beyond.push(...[...document.querySelectorAll(".verdict, h1")].filter((element) => element.scrollWidth > element.clientWidth));
        return [page.scrollWidth > page.clientWidth, main.scrollWidth > main.clientWidth, ...beyond.map(({ outerHTML }) => outerHTML.slice(0, 120))].filter(Boolean);
      });
      assert.deepEqual(cut, [], `${name} at ${width} × ${height}`);
      await picture(`${name}-${width}`);
      assert.deepEqual(await covered(), [], `${name} at ${width} × ${height}`);
    }
  }
  await page.setViewportSize({ width: 1280, height: 720 });
}

/** A clone has every parameter of its original, those that are objects within a group too; neither is waited for. */
async function clone(id) {
  const { mesh_id, cell, params } = await api(`/jobs/${id}`);
  const robust = { ...params.robust, pose_error: { angle_deg: 0.5, translation_mm: 0.25 } };
  const body = JSON.stringify({ mesh_id, cell, params: { ...params, robust } });
  const original = await (await fetch(`${base}api/v1/jobs`, { method: "POST", headers: { "content-type": "application/json" }, body })).json();
  await page.goto(`${base}#/new?from=${original.id}`);
  await page.locator(".create .placing").waitFor();
  await page.locator(".sticky button").click();
  await page.waitForFunction(() => /#\/jobs\/[0-9a-f-]{36}/.test(location.hash));
  const made = (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0];
  const [first, second] = [await api(`/jobs/${original.id}`), await api(`/jobs/${made}`)];
  assert.deepEqual(second.params, first.params);
  assert.deepEqual(second.params.robust.pose_error, robust.pose_error);
  for (const job of [original.id, made]) await fetch(`${base}api/v1/jobs/${job}/cancel`, { method: "POST" });
}

/** What is typed key by key stands in its field as it was typed, and the field keeps the focus; what is no JSON holds up the start. */
async function typed() {
  await page.goto(`${base}#/new`);
  await page.locator(".create details.group > summary").click();
  const find = (words) => page.locator(".params input[type=search]").fill(words);
  const enter = async (field, words) => {
    await field.click();
    await page.keyboard.press("Control+A");
    await page.keyboard.type(words);
    assert.deepEqual(await field.evaluate((field) => [field.value, field === document.activeElement]), [words, true]);
  };
  for (const [name, words, fault] of [["selection.target", "1.5", "Allowed: 0 to 1."], ["selection.target", "0,95", "with a point"], ["selection.target", "0.97"], ["selection.max_views", "0", "Allowed: 1 to"], ["selection.max_views", "12"], ["motion.clearance_mm", "12"], ["dialects.program_name", "part7"]]) {
    await find(name);
    await enter(page.locator(`.params input[aria-label="${name}"]`), words);
    if (!fault) { await page.locator(".params [aria-invalid=true]").waitFor({ state: "detached" }); continue; }
    await page.locator(`.params input[aria-label="${name}"][aria-invalid=true]`).waitFor();
    await page.locator(".params .problem", { hasText: fault }).waitFor();
    await page.locator(".sticky", { hasText: `Correct ${name} first.` }).waitFor();
  }
  await find("part.table_from_part");
  await page.locator(".pose button").click();
  await enter(page.locator('.pose input[aria-label="translation_mm 3"]'), "-150.5");
  await enter(page.locator(".grid input[type=number]"), "-5");
  await find("candidates.rolls_deg");
  await enter(page.locator(".params textarea"), "[0, 90");
  await page.locator(".sticky", { hasText: "Correct candidates.rolls_deg first." }).waitFor();
  await page.keyboard.type("]");
  await page.locator(".sticky", { hasNotText: "Correct" }).waitFor();
  await kept();
}

/** A form that is filled is there again after another view was shown; who leaves the page is asked. */
async function kept() {
  await page.goto(`${base}#/runs`);
  await page.locator("#runs-title").waitFor();
  await page.goBack();
  await page.locator(".create details.group > summary").click();
  assert.equal(await page.locator('.params input[aria-label="selection.target"]').inputValue(), "0.97");
  await anew();
}

/** Reads the page anew, which asks for what is filled in and then forgets it. */
async function anew() {
  const asked = page.waitForEvent("dialog");
  const read = page.reload();
  const dialog = await asked;
  assert.equal(dialog.type(), "beforeunload");
  await Promise.all([dialog.accept(), read]);
}

/** Of several files, each is let down by its own box, and one that is no mesh is named and holds up none; none is waited for. */
async function batch() {
  const corners = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
  const file = (name, text) => ({ name, mimeType: "model/stl", buffer: Buffer.from(text) });
  const solid = (height) => `solid\n${corners.map((face) => `facet normal 0 0 0\nouter loop\n${face
    .map((at) => `vertex ${["0 0 0", "40 0 0", "0 40 0", `0 0 ${height}`][at]}`).join("\n")}\nendloop\nendfacet`).join("\n")}\nendsolid\n`;
  await page.goto(`${base}#/new`);
  await page.locator("input[name=file]").setInputFiles([file("low.stl", solid(30)), file("none.stl", "solid none\n"), file("high.stl", solid(50))]);
  await page.locator("select[name=unit]").selectOption("mm");
  await page.locator(".drop .problem").waitFor();
  await page.locator('.create input[placeholder^="key=value"]').fill("walk=batch");
  // The buttons below the poses in which it stands are where they were before these appear.
  const below = () => page.evaluate(() => [".placing .actions", ".placing > summary"].map((one) => document.querySelector(one).getBoundingClientRect().top).reduce((one, two) => Math.round(one - two)));
  await page.locator(".placing > summary").click();
  const before = await below();
  await page.locator(".placing .poses li").first().waitFor();
  assert.equal(await below(), before, "what is about to be clicked stays where it is");
  await page.locator(".placing .actions button", { hasText: "−Z up" }).click();
  await page.locator(".placing > summary", { hasText: "By hand" }).waitFor();
  await page.locator(".sticky button").click();
  await page.locator("#message", { hasText: "none.stl" }).waitFor();
  const { items } = await api("/jobs?label=walk=batch");
  const heights = await Promise.all(items.map(async ({ id }) => (await api(`/jobs/${id}`)).params.part.table_from_part.translation_mm[2]));
  assert.deepEqual(heights.map(Math.round).sort(), [30, 50]);
  await page.getByRole("button", { name: "Remove none.stl" }).click();
  await page.locator(".drop li").waitFor({ state: "detached" });
  for (const { id } of items) await fetch(`${base}api/v1/jobs/${id}/cancel`, { method: "POST" });
  await anew();
}

/** Starts a run of the job that is open. */
async function begin(fields) {
  await tabTo(".jobhead .primary");
  await page.keyboard.press("Enter");
  for (const [name, value] of Object.entries(fields)) await page.locator(`dialog input[name=${name}]`)[value === true ? "check" : "fill"](value === true ? {} : value);
  await tabTo("dialog .primary");
  await page.keyboard.press("Enter");
  await page.locator("#run-state").waitFor();
}

const press = (name) => page.getByRole("button", { name, exact: true }).click();
/** Says in its dialog that something is to be deleted. */
const confirm = () => page.locator("dialog .danger").click();
const runId = async () => (await page.evaluate(() => location.hash)).split("/")[2];

/** Takes the connections that the page leaves of the six which a browser has to a server; what is asked then waits. */
async function crowded(work) {
  await page.evaluate(() => {
    window.crowd = new AbortController();
    return Promise.all([1, 2, 3, 4].map(() => fetch("api/v1/events", { signal: window.crowd.signal })));
  });
  await work();
  await page.evaluate(() => window.crowd.abort());
}

/** A run that is paused and resumed; false where it was done before. */
async function pausedAndResumed() {
  await page.route(/\/api\/v1\/(jobs\/[0-9a-f-]{36}\/(plan|program|coverage)|cells\/)/, () => {});
  // By its own clock, so that it is not over before it is stopped.
  await begin({ time_factor: "1", from_step: "1" });
  for (const [name, state] of [["Pause", "paused"], ["Resume", "running"]]) {
    await press(name);
    await page.locator(`#run-state:is(.${state}, .done)`).waitFor();
    if (await page.locator("#run-state.done").count()) return false;
    await page.getByRole("button", { name, exact: true, disabled: true }).waitFor();
    await frames();
    assert.equal(await page.evaluate(() => document.activeElement.textContent), name, "the button keeps the keyboard");
  }
  return true;
}

/** A run is paused, resumed and stopped by its buttons, stopped also where no connection is left; the next one would begin where
 *  it stopped. What does not come of its surroundings leaves the buttons as they are. */
async function control(id) {
  for (let attempts = 3; !(await pausedAndResumed()); attempts -= 1) {
    // The click of a busy machine may come when the run is over.
    assert.ok(attempts > 1, "a click was late each time");
    await page.unrouteAll();
    await page.goto(`${base}#/jobs/${id}/cell`);
    await page.locator(".player .primary").waitFor();
  }
  await page.locator("#connection[data-connection=live]").waitFor();
  // A Stop that is not sent says what to do, as long as the run goes on; in simulation nothing moves.
  const unsent = /\/api\/v1\/runs\/[0-9a-f-]{36}\/stop$/;
  await page.route(unsent, (route) => route.abort());
  await press("Stop");
  await page.locator(".runview .problem", { hasText: /^Stop is not confirmed/ }).waitFor();
  await page.unroute(unsent);
  forget(null);
  await crowded(async () => {
    // Looked at in the page, right after the click: the run may be over before the page can be asked.
    await page.evaluate(() => {
      const stop = [...document.querySelectorAll(".controls button")].find(({ textContent }) => textContent === "Stop");
      stop.addEventListener("click", () => setTimeout(() => { window.canStopAgain = !stop.disabled && !stop.ariaDisabled; }), { once: true });
    });
    await press("Stop");
    await page.waitForFunction(() => window.canStopAgain !== undefined);
    assert.ok(await page.evaluate(() => window.canStopAgain), "Stop can be pressed again");
    await page.locator("#run-state.stopped").waitFor();
  });
  await page.unrouteAll();
  await reload();
  const { step, from_step: from } = await api(`/runs/${await runId()}`);
  assert.equal(from, 1);
  await leftAt(await runId());
  await page.locator(".controls button", { hasText: "Run in simulation" }).click();
  assert.equal(Number(await page.locator("dialog input[name=from_step]").inputValue()), step);
  assert.equal(Number(await page.locator("dialog input[name=time_factor]").inputValue()), 1);
  await page.keyboard.press("Escape");
}

/** A run that is over is drawn where arm and table were last measured, also where no step was completed. The page is told of such a one. */
async function leftAt(id) {
  const at = (rest) => new RegExp(`/api/v1/runs/${id}${rest}$`);
  const run = await api(`/runs/${id}`);
  await page.route(at("(\\?wait=.*)?"), (route) => route.fulfill({ json: { ...run, last_measured: { joints_deg: [10, -40, 70, 5, 40, 0], table_angle_deg: 14.2 } } }));
  await page.route(at("/record"), (route) => route.fulfill({ json: { steps: [] } }));
  await page.reload();
  // Its cell comes by itself.
  await page.waitForFunction(() => {
    const scene = window.vantage?.run?.scene.current;
    if (!scene) return false;
    const [{ elements: m }, [, , z, w]] = [scene.onPlate.matrix, scene.model.cell.base_from_table.quaternion_xyzw];
    return Math.abs(Math.atan2(m[1], m[0]) - 2 * Math.atan2(z, w) - (14.2 * Math.PI) / 180) < 1e-6;
  });
  assert.match(await page.locator("#shown").innerText(), /last measured/);
  await page.unrouteAll();
}

/** A run that pauses after each step is begun and led on by its button. */
async function stepped(id) {
  await page.goto(`${base}#/jobs/${id}/cell`);
  await page.locator(".player .primary").waitFor();
  await begin({ time_factor: "20", single_step: true });
  await page.locator("#run-state.armed").waitFor();
  await page.getByRole("button", { name: "Resume", exact: true, disabled: false }).waitFor();
  // The step that comes next is told.
  for (const step of [1, 2]) {
    await press("Carry out one step");
    await page.waitForFunction((step) => {
      const isNext = document.querySelector("#run-progress").textContent.startsWith(`${step} `);
      return document.querySelector("#run-state.paused") && isNext;
    }, step);
  }
  await press("Stop");
  await page.locator("#run-state.stopped").waitFor();
}

/** A live run is armed by the name of the cell as the operator writes it. No machine is connected here: the page is told of the last
 *  run that it waits to be armed, and what the page sends is looked at. */
async function arm() {
  const run = (await api("/runs?page_size=1")).items[0];
  const waiting = { ...run, mode: "live", state: "ready", reason: "awaits_arm" };
  const at = (rest) => new RegExp(`/api/v1/runs/${run.id}${rest}$`);
  await page.route(at(""), (route) => route.fulfill({ json: waiting }));
  await page.route(at("/events"), (route) => route.fulfill({ status: 204 }));
  await page.route(at("/arm\\?token=\\d+"), (route) => route.fulfill({ json: waiting }));
  // The page of the run before is left: one that is still shown would not ask anew.
  await page.goto(`${base}#/runs`);
  await page.locator("#runs-title").waitFor();
  await page.goto(`${base}#/runs/${run.id}`);
  await page.locator("#run-state.ready").waitFor();
  const speed = page.getByRole("slider", { name: "Speed" });
  assert.ok(await speed.isDisabled(), "the speed of a live run is for who holds the lease");
  await tabTo("input[name=operator]");
  await page.keyboard.type("Ada");
  await press("Take the lease");
  await page.locator("#lease-state", { hasText: "Held by this page" }).waitFor();
  assert.ok(await speed.isEnabled());
  const button = page.getByRole("button", { name: "Arm", exact: true });
  assert.ok(await button.isDisabled(), "nothing is armed before the cell is named");
  await tabTo("input[name=cell]", 200);
  await page.keyboard.type("as the operator writes it");
  await check("arm");
  const [sent] = await Promise.all([page.waitForRequest(at("/arm\\?token=\\d+")), button.click()]);
  assert.deepEqual(sent.postDataJSON(), { cell: "as the operator writes it", operator: "Ada" });
  await page.route(at("/stop"), (route) => route.abort());
  await press("Stop");
  await page.locator(".runview .problem", { hasText: /^Press the cell's emergency stop\. Stop is not confirmed/ }).waitFor();
  forget(null);
  await press("Give it back");
  await page.locator("#lease-state", { hasText: "Nobody holds it" }).waitFor();
  await page.unrouteAll();
}

async function run() {
  await begin({ time_factor: "20" });
  assert.match(await page.locator(".safety").innerText(), /not safety-rated/);
  await page.waitForFunction(() => (window.vantage.run?.samples.value.length ?? 0) > 3);
  await check("run");
  await page.locator("#run-state.done").waitFor();
  const id = await runId();
  const [{ coverage, steps, step: last }, samples] = [await runEnded(id), await page.evaluate(() => window.vantage.run.samples.value.length)];
  assert.equal(last, steps);
  assert.ok(Math.abs(coverage.measured_of_asked - coverage.planned_of_asked) < 0.01);
  // The newest event is in view, below those that are scrolled past.
  await page.waitForFunction(() => {
    const { scrollTop, scrollHeight, clientHeight } = document.querySelector(".log");
    return scrollTop > 0 && scrollHeight - scrollTop - clientHeight < 2;
  });
  await reload();
  await page.locator("#run-state.done").waitFor();
  // The curves of a run that is over are drawn from its record.
  await page.locator(".runview .chart canvas").nth(1).waitFor();
  return samples;
}

const send = async (path, body, type = "application/json") => {
  const answer = await fetch(`${base}api/v1${path}`, { method: "POST", headers: { "content-type": type }, body: type.includes("json") ? JSON.stringify(body) : body });
  assert.ok(answer.ok, `${path}: ${answer.status}`);
  return answer.json();
};

/** A job once it has ended, however busy the machine is. */
async function jobEnded(id) {
  for (;;) {
    const job = await api(`/jobs/${id}?wait=60s`);
    if (!["queued", "running"].includes(job.state)) return job;
  }
}

/** A run once its coverage is stored, which is after its end is told. */
async function runEnded(id) {
  for (;;) {
    const run = await api(`/runs/${id}?wait=60s`);
    if (run.coverage) return run;
    await new Promise((waited) => { setTimeout(waited, 200); });
  }
}

/** A job that is sent and has ended. */
const ended = async (request) => jobEnded((await send("/jobs", request)).id);

/** A wedge in two plans: with one view, and turned over. */
async function wedges() {
  const facets = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map((face) => face.map((at) => `vertex ${["0 0 0", "40 0 0", "0 40 0", "0 0 30"][at]}`).join("\n"));
  const solid = `solid\n${facets.map((corners) => `facet normal 0 0 0\nouter loop\n${corners}\nendloop\nendfacet`).join("\n")}\nendsolid\n`;
  const mesh = await send("/meshes?unit=mm&name=wedge.stl", solid, "model/stl");
  const request = { mesh_id: mesh.id, cell: "e05-transcan" };
  const one = await ended({ ...request, params: { selection: { max_views: 1 }, missed: { remedies: 0 } } });
  const two = await ended({ ...request, params: { setups: 2, registration: "none", selection: { max_views: 4 }, missed: { remedies: 0 } } });
  assert.deepEqual([one.state, two.state, two.summary.setups], ["succeeded", "succeeded", 2]);
  return { mesh, one, two };
}

/** A failed job says what is wrong at which field, and leads to that field of a copy. */
async function failed({ mesh }) {
  const request = { mesh_id: mesh.id, cell: "e05-transcan" };
  const high = { table_from_part: { translation_mm: [0, 0, 10], rpy_deg: [0, 0, 0] } };
  const job = await ended({ ...request, params: { part: high } });
  assert.equal(job.state, "failed");
  const [{ pointer, detail }] = job.problem.errors;
  await page.goto(`${base}#/jobs/${job.id}`);
  const fix = page.locator(".faults a");
  await fix.waitFor();
  const shown = await page.locator(".failure").innerText();
  for (const part of [job.problem.title, pointer, detail, "Next steps"]) assert.ok(shown.includes(part), part);
  await check("failed");
  await tabTo(".faults a");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.activeElement?.closest('[data-field="part.table_from_part"]'));
  assert.match(await page.locator(".create .problem").first().innerText(), /above the plate/);
  // Where there is a report on it, the page leads there, and to each parameter that the reasons name.
  const strict = await ended({ ...request, params: { limits: { camera_deg: 1, projector_deg: 1 } } });
  assert.equal(strict.problem?.code, "no_plan", JSON.stringify(strict.problem));
  await page.goto(`${base}#/jobs/${strict.id}`);
  await page.locator('.failure a[href*="at=limits.camera_deg"]').waitFor();
  const report = await fetch(await page.locator(".failure .actions a[target=_blank]").evaluate((link) => link.href));
  assert.ok(report.ok && /^<!doctype html>/i.test(await report.text()));
  return job.id;
}

/** A file that would fit in several units can be read in each of them. */
async function otherUnits({ mesh }) {
  const file = await (await fetch(`${base}api/v1/meshes/${mesh.id}/file`)).text();
  const metres = await send("/meshes?unit=m&name=metres.stl", file, "model/stl");
  const job = await ended({ mesh_id: metres.id, cell: "e05-transcan" });
  assert.match(JSON.stringify(job.problem), /in mm \(.*, or cm \(/);
  await page.goto(`${base}#/jobs/${job.id}`);
  // The view of the failure before stands until the address is read.
  const offered = page.locator(".failure[data-code=job_input_invalid] .actions button");
  await offered.first().waitFor();
  assert.deepEqual(await offered.allInnerTexts(), ["mm", "cm"].map((unit) => `Read the file in ${unit} and plan again`));
  await offered.last().click();
  await page.waitForFunction((id) => /#\/jobs\/[0-9a-f-]{36}/.test(location.hash) && !location.hash.includes(id), job.id);
  const made = (await page.evaluate(() => location.hash)).split("/")[2].split("?")[0];
  assert.equal((await api(`/meshes/${(await api(`/jobs/${made}`)).mesh_id}`)).unit, "cm");
  await fetch(`${base}api/v1/jobs/${made}/cancel`, { method: "POST" });
}

/** Tells the page other things of a job than the server, in lists too, which wait for `held`; `answer` gives the response to a request for it. */
async function pretend(id, told, answer, held) {
  await page.route(new RegExp(`/api/v1/jobs/${id}$`), answer);
  await page.route(/\/api\/v1\/jobs\?/, async (route) => {
    const response = await route.fetch();
    const list = await response.json();
    await held;
    await route.fulfill({ response, json: { ...list, items: list.items.map((job) => (job.id === id ? { ...job, ...told } : job)) } });
  });
}

/**
 * Of a job whose end is told, what is shown waits until the job is read once more. The page is told of one that has ended that it runs,
 * also by a list that was on its way when the end was told.
 */
async function watched(id, tab, shown) {
  const whole = await api(`/jobs/${id}`);
  const running = { ...whole, state: "running", ended_at: null, summary: null, results: [], timings: {}, warnings: [], problem: null };
  let answer = Promise.resolve();
  let isEnded = false;
  let list;
  await pretend(id, running, async (route) => {
    await answer;
    return isEnded ? route.continue() : route.fulfill({ json: running });
  }, new Promise((done) => { list = done; }));
  await page.goto(`${base}#/jobs/${id}/${tab}`);
  await page.reload();
  const said = (words) => page.locator(".panel > [role=status]", { hasText: words }).waitFor();
  await said("has no plan yet");
  await page.locator("#connection[data-connection=live]").waitFor();
  let deliver;
  answer = new Promise((done) => { deliver = done; });
  isEnded = true;
  await page.evaluate(({ id, state }) => window.vantage.applyEvent({ id: "", kind: state, data: { job_id: id, state, stage: null, fraction: 1 } }), { id, state: whole.state });
  await said("Loading…");
  list();
  await page.waitForTimeout(1500);
  assert.equal(await page.locator(".panel").innerText(), "Loading…", "nothing is shown of what is not read");
  deliver();
  await page.locator(shown).first().waitFor({ timeout: 60_000 });
  await page.unrouteAll({ behavior: "wait" });
}

/** A doubtful unit is told wherever one looks at the job; other warnings stand in its summary. The page is told of both. */
async function doubtful(id) {
  const whole = await api(`/jobs/${id}`);
  const warnings = ["part_small", "part_unstable"].map((code) => ({ code, pointer: "/mesh_id", detail: `is ${code}`, remedy: "check it" }));
  await pretend(id, { warnings }, (route) => route.fulfill({ json: { ...whole, warnings } }));
  await page.goto(`${base}#/jobs/${id}/cell`);
  await page.reload();
  await page.locator(".jobhead .warnings", { hasText: "is part_small" }).waitFor();
  assert.equal(await page.locator(".jobhead .warnings p").count(), 1);
  await page.unrouteAll({ behavior: "wait" });
}

/** Where nothing is any more, the page says so in its own words, and offers no further attempt. */
async function gone() {
  const id = "01a20000-0000-7000-8000-000000000000";
  for (const room of ["jobs", "runs", "inspections", "calibrations"]) {
    await page.goto(`${base}#/${room}/${id}`);
    // The view before says the same until the address is read.
    assert.match(await page.locator(`#main[data-room=${room}] .problem`).innerText(), /^Nothing was found at this address/);
    assert.equal(await page.locator("#main .problem button").count(), 0, room);
    assert.ok(!(await page.locator("#main").innerText()).includes(id), room);
  }
  forget(404);
}

/** A file of CAD is told how to become one that can be read, and no sizes are promised. */
async function cad() {
  await page.goto(`${base}#/new`);
  await page.locator("input[name=file]").setInputFiles({ name: "part.step", mimeType: "model/step", buffer: Buffer.from("ISO-10303-21;\nHEADER;\nENDSEC;\n") });
  await page.locator(".drop .problem", { hasText: "must be exported as STL, OBJ or PLY" }).waitFor();
  await page.locator("select[name=unit]").waitFor();
  assert.ok(!(await page.locator(".create").innerText()).includes("sizes below"));
  await anew();
}

/** The size that is written at the part is whole, however close to the edge of the view it comes. */
async function labelled(id) {
  await page.goto(`${base}#/new?from=${id}`);
  await page.locator(".stage .label").waitFor();
  await page.locator(".stage canvas").focus();
  for (let closer = 0; closer < 24; closer += 1) {
    await page.keyboard.press("+");
    await frames();
    const beyond = await page.evaluate(() => {
      const [label, stage] = [".stage .label", ".stage"].map((one) => document.querySelector(one).getBoundingClientRect());
      return label.width > 0 ? label.right - stage.right : 0;
    });
    assert.ok(beyond <= 0, `the size is cut off by ${beyond} pixels`);
  }
}

/** The part stands as in the setup that is chosen, with the views of that setup; a view of the other one brings its setup along. */
async function setups({ two }) {
  const { setups, viewpoints } = await api(`/jobs/${two.id}/plan`);
  await page.goto(`${base}#/jobs/${two.id}/plan?panel=views`);
  const lies = (setup) => page.waitForFunction(({ pose, views }) => {
    const scene = window.vantage.plan?.scene.stage.scene;
    const lying = scene?.getObjectByName("lying");
    const off = lying && Math.hypot(...pose.translation_mm.map((value, i) => value - lying.matrix.elements[12 + i]));
    return off < 1e-6 && (scene.getObjectByName("viewpoints")?.count ?? 0) === views;
  }, { pose: setups[setup].table_from_part, views: setups[setup].viewpoints.length });
  await lies(0);
  const lowest = await page.evaluate(() => {
    const part = window.vantage.plan.scene.stage.scene.getObjectByName("part");
    const { array } = part.geometry.attributes.position;
    // Otherwise it is that of the frame before.
    part.updateWorldMatrix(true, false);
    const m = part.matrixWorld.elements;
    return Math.min(...Array.from({ length: array.length / 3 }, (_, i) => m[2] * array[3 * i] + m[6] * array[3 * i + 1] + m[10] * array[3 * i + 2] + m[14]));
  });
  assert.ok(Math.abs(lowest) < 0.01, `it stands on the plate: ${lowest}`);
  await page.locator("select[name=setup]").selectOption("1");
  await lies(1);
  await page.waitForFunction(() => /setup=1/.test(location.hash));
  await reload();
  await lies(1);
  const first = viewpoints.find(({ id }) => setups[0].viewpoints.includes(id));
  await page.locator(".views .row").nth(viewpoints.indexOf(first)).click();
  await lies(0);
  assert.equal(await page.locator(".label.chosen").innerText(), `${first.id} · ${first.label}`);
}

/** The map of what only one of two plans measures: its areas are the part's. */
async function compare({ mesh, one, two }) {
  await page.goto(`${base}#/compare/${one.id}/${two.id}`);
  await page.waitForFunction(() => [...window.vantage.stages].filter((stage) => stage.frames > 0).length === 3);
  const rows = page.locator(".compare .legend tr");
  await rows.first().waitFor();
  const areas = Object.fromEntries(await rows.evaluateAll((rows) => rows.map(({ dataset }) => [dataset.key, Number(dataset.mm2)])));
  const total = Object.values(areas).reduce((sum, area) => sum + area, 0);
  assert.ok(Math.abs(total / mesh.health.area_mm2 - 1) < 1e-4, `${total} of ${mesh.health.area_mm2}`);
  assert.ok(areas.both > 0 && areas.second > areas.both, JSON.stringify(areas));
  await check("compare");
  // Swapped, the map and its legend say the same of the other plan.
  const before = await painted();
  const colourOf = (key) => Object.keys(before).find((colour) => Math.abs(before[colour] - (areas[key] ?? 0)) < 1e-3 * total);
  await press("Swap");
  await page.locator(`.pair.three > :first-child a[href*="${two.id}"]`).waitFor();
  await page.waitForFunction(() => [...window.vantage.stages].filter((stage) => stage.frames > 0).length === 3);
  await page.waitForFunction((mm2) => Math.abs(Number(document.querySelector(".compare .legend [data-key=first]")?.dataset.mm2) - mm2) < 1, areas.second);
  const after = await painted();
  assert.ok(Math.abs((after[colourOf("second")] ?? 0) - (areas.first ?? 0)) < 1e-3 * total, `${JSON.stringify(before)}, swapped ${JSON.stringify(after)}`);
  return areas;
}

/** Areas of the map of two plans by their colour. */
const painted = async () => (await page.waitForFunction(() => {
  const stage = [...window.vantage.stages].find(({ container }) => container.dataset.name === "compare-difference");
  const part = stage?.scene.getObjectByName("part");
  if (!part) return null;
  const { color, position } = part.geometry.attributes;
  const areas = {};
  for (let i = 0; i < position.array.length; i += 9) {
    const [a, b] = [3, 6].map((corner) => [0, 1, 2].map((axis) => position.array[i + corner + axis] - position.array[i + axis]));
    const key = [...color.array.slice(i, i + 3)].join();
    areas[key] = (areas[key] ?? 0) + Math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]) / 2;
  }
  return areas;
})).jsonValue();

let last = "";
for (const part of parts) {
  const file = basename(part.file);
  const { id, poses } = await start(part);
  step(`plan of ${file}`);
  const job = await jobEnded(id);
  await page.locator(".jobhead .state:not(.queued):not(.running)").waitFor();
  assert.equal(job.state, "succeeded", JSON.stringify(job.problem));
  step("inspect a spot, change views");
  const { agreement, dropped } = await inspect(id, file);
  assert.ok(agreement > 0.97, `visibility in the browser and in the plan: ${agreement}`);
  step("colours");
  await colours(id);
  step("regions");
  await regions(id);
  step("play");
  const { off, gaps } = await play(id);
  if (!last) {
    for (const way of [() => control(id), () => stepped(id), arm, () => clone(id), () => labelled(id), typed, batch, cad, suits]) {
      step(way.name || String(way));
      await way();
    }
    await page.goto(`${base}#/jobs/${id}/cell`);
    await page.locator(".player .primary").waitFor();
  }
  step("run");
  const samples = await run();
  await page.goto(`${base}#/jobs/${id}/plan`);
  await tabTo('.jobhead a[target="_blank"]');
  const report = await fetch(await page.evaluate(() => document.activeElement.href));
  assert.ok(report.ok && /^<!doctype html>/i.test(await report.text()));
  figures.parts.push({ file, views: job.summary.views, agreement, dropped, off_mm: off, clearance_off_mm: gaps, poses, samples });
  last = id;
  figures.first ??= id;
}
step("inspection of scans");
const inspected = await inspectScans(figures.first, parts[0]);
figures.inspection = inspected;
step("a part that is not found");
await notFound(inspected.first);
step("rig");
figures.rig_off_mm = await rig(await api(`/jobs/${last}/plan`));
step("reach");
figures.reach = await reach();
step("calibration");
const calibration = await calibrate();
step("versions");
await versions();
step("a list of more than a page");
await older();
for (const [name, hash] of Object.entries({ jobs: "#/jobs", runs: "#/runs", specs: "#/specs/scanners/transcan-c", robot: "#/specs/robots/ur5e" })) {
  step(name);
  await page.goto(base + hash);
  await settled();
  await page.waitForTimeout(1500);
  await check(name);
}
step("wedges");
const wedge = await wedges();
step("a failed job");
const failure = await failed(wedge);
step("a file that fits in several units");
await otherUnits(wedge);
step("jobs that are watched to their end");
await watched(wedge.one.id, "plan", ".side .summary li");
await watched(wedge.one.id, "cell", ".player");
await watched(failure, "plan", ".failure[data-code=job_input_invalid]");
step("a doubtful unit");
await doubtful(wedge.one.id);
step("what is gone");
await gone();
step("setups");
await setups(wedge);
step("comparison");
figures.compared = await compare(wedge);
step("what cannot be read");
await unread();
step("focus after a deletion");
await focusAfterDeletion(wedge);
step("time zones");
await zones(["#/jobs", "#/runs", "#/inspections", `#/inspections/${inspected.first}`, "#/calibrations", calibration, `#/jobs/${figures.first}/inspection`]);
step("sizes");
if (isAtRoot) await fits({ jobs: "#/jobs", plan: `#/jobs/${last}/plan`, cell: `#/jobs/${last}/cell`, results: `#/jobs/${last}/results`, new: "#/new",
  hardware: "#/specs/scanners/transcan-c", runs: "#/runs", calibrations: "#/calibrations", calibration, inspections: "#/inspections", scans: `#/jobs/${figures.first}/inspection`,
  inspection: `#/inspections/${inspected.second}`, failed: `#/jobs/${failure}`, compare: `#/compare/${wedge.one.id}/${wedge.two.id}` });
await page.emulateMedia({ colorScheme: "dark" });
await page.goto(`${base}#/jobs`);
await settled();
await check("jobs-dark");
assert.deepEqual(seen.errors, [], "the console");
assert.deepEqual(seen.foreign, [], "requests to elsewhere");
figures.requests = seen.requests;
await browser.close();
console.log(JSON.stringify(figures));
