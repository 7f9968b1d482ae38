"""Plans a part with the client that openapi-python-client made in the current folder: upload, job, wait, plan, program.

Usage: client_plan.py BASE_URL MESH_FILE; prints what it got as one line of JSON.
"""

import json
import sys
from io import BytesIO
from pathlib import Path

from client import AuthenticatedClient
from client.api.jobs import create_job, create_jobs, delete_jobs, get_job, list_jobs
from client.api.meshes import get_mesh_file, get_mesh_preview, upload_mesh
from client.api.results import get_plan, get_program, get_program_text, get_report
from client.models import (
    CandidateParams,
    Job,
    JobBatch,
    JobBatchRequest,
    JobPage,
    JobRequest,
    JobSelection,
    JobSort,
    JobState,
    Mesh,
    MissedParams,
    PartParams,
    PlanDocument,
    PlanParams,
    Problem,
    ProgramDialect,
    ProgramDocument,
    SelectionParams,
    SparseJobPage,
    Strategy,
    UploadMeshUnit,
)
from client.types import File

# Few views, few samples: the client is what is tried.
QUICK = PlanParams(
    candidates=CandidateParams(strategies=[Strategy.ELLIPSOID], rolls_deg=[0.0], step_small_deg=60.0, step_large_deg=60.0),
    part=PartParams(patch_edge_mm=20.0, samples_per_mm2=0.01),
    selection=SelectionParams(max_views=2),
    missed=MissedParams(remedies=0),
)


def plan(client: AuthenticatedClient, mesh_file: Path) -> dict[str, object]:
    mesh = upload_mesh.sync(
        client=client, body=File(payload=BytesIO(mesh_file.read_bytes())), unit=UploadMeshUnit.MM, name="part.stl"
    )
    assert isinstance(mesh, Mesh), mesh
    request = JobRequest(mesh_id=mesh.id, cell="e05-transcan", params=QUICK, part_number="PN-1", serial="S-1")
    job = create_job.sync(client=client, body=request, idempotency_key="order-1")
    assert isinstance(job, Job), job
    for _ in range(60):
        found = get_job.sync(job.id, client=client, wait="10s")
        assert isinstance(found, Job), found
        if found.state not in (JobState.QUEUED, JobState.RUNNING):
            job = found
            break
    assert job.state is JobState.SUCCEEDED, job.to_dict()

    document = get_plan.sync(job.id, client=client)
    program = get_program.sync(job.id, client=client)
    report = get_report.sync(job.id, client=client)
    assert isinstance(document, PlanDocument), document
    assert isinstance(program, ProgramDocument), program
    assert isinstance(report, str), report
    texts: dict[str, str] = {}
    for dialect in ProgramDialect:
        text = get_program_text.sync(job.id, dialect, client=client)
        # A language that cannot say the program says why.
        texts[dialect.value] = text if isinstance(text, str) else f"refused: {text.code}" if isinstance(text, Problem) else ""
    preview = get_mesh_preview.sync(mesh.id, client=client)
    original = get_mesh_file.sync(mesh.id, client=client)
    assert isinstance(preview, File) and isinstance(original, File)

    listed = list_jobs.sync(client=client, serial="S-1", mesh=mesh.id, sort=JobSort.CREATED_AT_DESCENDING)
    assert isinstance(listed, JobPage), listed
    sparse = list_jobs.sync(client=client, fields="id,state")
    assert isinstance(sparse, SparseJobPage), sparse
    viewpoints_alone = JobRequest(mesh_id=mesh.id, cell="none", params=QUICK, serial="S-2")
    batch = create_jobs.sync(client=client, body=JobBatchRequest(jobs=[viewpoints_alone, viewpoints_alone]))
    assert isinstance(batch, JobBatch), batch
    for other in batch.jobs:
        get_job.sync(other.id, client=client, wait="60s")
    deleted = delete_jobs.sync(client=client, body=JobSelection(serial="S-2"))
    assert deleted is not None and not isinstance(deleted, Problem), deleted
    # A refusal comes as the type that it is.
    refused = create_job.sync(client=client, body=JobRequest(mesh_id=mesh.id, cell="nowhere"))
    assert isinstance(refused, Problem), refused
    return {
        "job": str(job.id),
        "viewpoints": len(document.viewpoints),
        "steps": len(program.steps),
        "plan_sha256": program.plan_sha256,
        "job_plan_sha256": job.plan_sha256,
        "report": report[:15],
        "texts": {name: text[:40] for name, text in texts.items()},
        "preview": preview.payload.read()[:4].decode(),
        "original": original.payload.read() == mesh_file.read_bytes(),
        "listed": [str(item.id) for item in listed.items],
        "sparse": [sorted(item.to_dict()) for item in sparse.items],
        "deleted": deleted.deleted,
        "refused": [refused.code, refused.errors[0].pointer],
    }


if __name__ == "__main__":
    address, part = sys.argv[1:]
    # The server has no key; a client that sends one is let in all the same.
    print(json.dumps(plan(AuthenticatedClient(base_url=address, token="none", timeout=None), Path(part))))
