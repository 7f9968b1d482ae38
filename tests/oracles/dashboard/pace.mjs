// Time until a part of 300 000 triangles is seen in its colours, with 3D drawn in software: from the address to the first picture of
// the plan, of a page that has nothing yet and of one that has been here before. Argument: address of the server. Prints one line
// of JSON with the figures; what they may be is for the reader, since the machine has other work too.
import assert from "node:assert/strict";
import { open } from "./browser.mjs";

const base = process.argv[2];
const api = `${base}api/v1`;
const [ROWS, COLUMNS] = [388, 388];

/** A ball with waves, as a binary STL: two triangles for each place of a grid. */
function wavyBall() {
  const at = (row, column) => {
    const [polar, azimuth] = [(Math.PI * row) / ROWS, (2 * Math.PI * (column % COLUMNS)) / COLUMNS];
    const radius = 40 + 2 * Math.sin(9 * polar) * Math.sin(7 * azimuth);
    return [radius * Math.sin(polar) * Math.cos(azimuth), radius * Math.sin(polar) * Math.sin(azimuth), -radius * Math.cos(polar)];
  };
  const faces = [];
  for (let row = 0; row < ROWS; row += 1) {
    for (let column = 0; column < COLUMNS; column += 1) {
      const [a, b, c, d] = [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
      if (row > 0) faces.push([a, b, c]);
      if (row < ROWS - 1) faces.push([a, c, d]);
    }
  }
  const file = new DataView(new ArrayBuffer(84 + 50 * faces.length));
  file.setUint32(80, faces.length, true);
  faces.forEach((corners, face) => corners.flat().forEach((value, i) => file.setFloat32(84 + 50 * face + 12 + 4 * i, value, true)));
  return { body: file.buffer, faces: faces.length };
}

const post = async (path, body, type) => {
  const answer = await fetch(`${api}${path}`, { method: "POST", headers: { "content-type": type }, body });
  assert.ok(answer.ok, `${path}: ${answer.status} ${await answer.clone().text()}`);
  return answer.json();
};

const ball = wavyBall();
const mesh = await post("/meshes?unit=mm&name=wavy-ball.stl", ball.body, "model/stl");
const params = { candidates: { strategies: ["ellipsoid"], rolls_deg: [0], step_small_deg: 90, step_large_deg: 90 },
  part: { patch_edge_mm: 20, samples_per_mm2: 0.05 }, missed: { remedies: 0 }, selection: { max_views: 2 }, setups: 1 };
const { id } = await post("/jobs", JSON.stringify({ mesh_id: mesh.id, cell: "none", params }), "application/json");
let job;
do job = await (await fetch(`${api}/jobs/${id}?wait=60s`)).json(); while (["queued", "running"].includes(job.state));
assert.equal(job.state, "succeeded", JSON.stringify(job.problem));
// The server makes a preview when it is first asked for.
const asked = performance.now();
await (await fetch(`${api}/meshes/${mesh.id}/preview.glb`)).arrayBuffer();
const preview = performance.now() - asked;

const { browser, page, seen } = await open(base, { colorScheme: "light" });
/** Milliseconds from the beginning of the navigation to the first frame with the coloured part. */
async function firstView() {
  await page.waitForFunction(() => window.vantage?.plan?.scene.stage.frames > 0);
  return page.evaluate(() => {
    const { scene, model } = window.vantage.plan;
    const pixels = scene.stage.pixels();
    return { ms: performance.now(), triangles: scene.stage.scene.getObjectByName("part").geometry.attributes.position.count / 3,
      faces: model.mesh.faces, colours: pixels.colours, drawn: pixels.drawn };
  });
}
await page.goto(`${base}#/jobs/${id}/plan`);
const first = await firstView();
await page.reload();
const again = await firstView();
assert.ok(first.triangles > 0.95 * ball.faces && first.triangles <= 300_000, `${first.triangles} of ${ball.faces} triangles`);
assert.ok(first.drawn > 0.05 && first.colours > 5, JSON.stringify(first));
assert.deepEqual([seen.errors, seen.foreign], [[], []]);

// Turning it: what a frame takes, drawn by the processor.
const FRAMES = 20;
const turning = await page.evaluate(async (count) => {
  const { stage } = window.vantage.plan.scene;
  const begun = performance.now();
  for (let i = 0; i < count; i += 1) {
    stage.canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true }));
    await new Promise(requestAnimationFrame);
  }
  return (performance.now() - begun) / count;
}, FRAMES);
await browser.close();
console.log(JSON.stringify({ triangles: first.triangles, preview_ms: Math.round(preview), first_view_ms: Math.round(first.ms),
  second_view_ms: Math.round(again.ms), turning_ms_a_frame: Math.round(turning) }));
