// Plans a part with the types that openapi-typescript made: upload, job, wait, plan, program.
// Usage: node client_plan.js BASE_URL MESH_FILE; prints what it got as one line of JSON.

import { readFileSync } from "node:fs";
import createClient from "openapi-fetch";
import type { components, paths } from "./schema.js";

type Job = components["schemas"]["Job"];
type JobRequest = components["schemas"]["JobRequest"];

const [baseUrl = "", meshFile = ""] = process.argv.slice(2);
const client = createClient<paths>({ baseUrl });

/** The answer to a request that must succeed. */
function told<T>(answer: { data?: T; error?: unknown; response: Response }): T {
  if (answer.data === undefined) throw new Error(`${answer.response.url}: ${JSON.stringify(answer.error)}`);
  return answer.data;
}

const bytes = readFileSync(meshFile);
const mesh = told(await client.POST("/api/v1/meshes", {
  params: { query: { unit: "mm", name: "part.stl" } },
  headers: { "Content-Type": "application/octet-stream" },
  body: bytes.toString("latin1"),
  bodySerializer: (body) => body,
}));

// Few views, few samples: the client is what is tried.
const request: JobRequest = {
  mesh_id: mesh.id,
  cell: "e05-transcan",
  part_number: "PN-1",
  serial: "S-1",
  params: {
    candidates: { strategies: ["ellipsoid"], rolls_deg: [0], step_small_deg: 60, step_large_deg: 60 },
    part: { patch_edge_mm: 20, samples_per_mm2: 0.01 },
    selection: { max_views: 2 },
    missed: { remedies: 0 },
  },
};
let job: Job = told(await client.POST("/api/v1/jobs", { params: { header: { "Idempotency-Key": "order-1" } }, body: request }));
const ended: Job["state"][] = ["succeeded", "failed", "cancelled"];
for (let round = 0; round < 60 && !ended.includes(job.state); round++) {
  // Without `fields` the answer is the whole job.
  job = told(await client.GET("/api/v1/jobs/{id}", { params: { path: { id: job.id }, query: { wait: "10s" } } })) as Job;
}
if (job.state !== "succeeded") throw new Error(JSON.stringify(job));

const path = { id: job.id };
const plan = told(await client.GET("/api/v1/jobs/{id}/plan", { params: { path } }));
const program = told(await client.GET("/api/v1/jobs/{id}/program", { params: { path } }));
const rapid = told(await client.GET("/api/v1/jobs/{id}/program/{dialect}", {
  params: { path: { ...path, dialect: "csv" } },
  parseAs: "text",
}));
const report = told(await client.GET("/api/v1/jobs/{id}/report", { params: { path }, parseAs: "text" }));
const preview = told(await client.GET("/api/v1/meshes/{id}/preview.glb", { params: { path: { id: mesh.id } }, parseAs: "arrayBuffer" }));
const listed = told(await client.GET("/api/v1/jobs", { params: { query: { serial: "S-1", sort: "-created_at" } } }));
const sparse = told(await client.GET("/api/v1/jobs", { params: { query: { fields: "id,state" } } }));
const refused = await client.POST("/api/v1/jobs", { body: { ...request, cell: "nowhere" } });

console.log(JSON.stringify({
  job: job.id,
  viewpoints: plan.viewpoints.length,
  steps: program.steps.length,
  plan_sha256: program.plan_sha256,
  job_plan_sha256: job.plan_sha256,
  table: rapid.split("\n", 1)[0],
  report: report.slice(0, 15),
  preview: new TextDecoder().decode(preview.slice(0, 4)),
  listed: listed.items.map((item) => item.id),
  sparse: sparse.items.map((item) => Object.keys(item).sort()),
  refused: [refused.error?.code, refused.error?.errors[0]?.pointer],
}));
