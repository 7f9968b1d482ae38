-- Times are UTC, '2026-01-31T12:00:00.000Z', written by the database alone: one clock, and text order is time order.

CREATE TABLE mesh (
    id         TEXT PRIMARY KEY,
    sha256     TEXT NOT NULL,
    unit       TEXT NOT NULL,
    name       TEXT,
    size_bytes INTEGER NOT NULL,
    health     TEXT NOT NULL,
    preview    TEXT,
    created_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
) STRICT;
CREATE INDEX mesh_by_file ON mesh (sha256);

CREATE TABLE spec (
    kind    TEXT NOT NULL,
    name    TEXT NOT NULL,
    version INTEGER NOT NULL,
    body    TEXT NOT NULL,
    PRIMARY KEY (kind, name)
) STRICT;

CREATE TABLE job (
    id          TEXT PRIMARY KEY,
    state       TEXT NOT NULL,
    mesh_id     TEXT NOT NULL,
    request     TEXT NOT NULL,
    input       TEXT NOT NULL,
    part_number TEXT,
    labels      TEXT NOT NULL,
    priority    INTEGER NOT NULL,
    stage       TEXT,
    fraction    REAL NOT NULL DEFAULT 0,
    attempts    INTEGER NOT NULL DEFAULT 0,
    timings     TEXT NOT NULL DEFAULT '{}',
    problem     TEXT,
    created_at  TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    started_at  TEXT,
    ended_at    TEXT
) STRICT;
CREATE INDEX job_queue ON job (priority DESC, id) WHERE state = 'queued';

-- Meshes that a job reads: its part, the fixture, meshes of bodies. None of them is deleted before the job has ended.
CREATE TABLE job_mesh (
    job_id  TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    mesh_id TEXT NOT NULL,
    PRIMARY KEY (job_id, mesh_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_mesh_by_mesh ON job_mesh (mesh_id);

CREATE TABLE artifact (
    job_id     TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    name       TEXT NOT NULL,
    sha256     TEXT NOT NULL,
    size_bytes INTEGER NOT NULL,
    PRIMARY KEY (job_id, name)
) STRICT;
CREATE INDEX artifact_by_file ON artifact (sha256);

-- AUTOINCREMENT: a number is never given twice, also after the newest events were pruned.
CREATE TABLE event (
    id     INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id TEXT NOT NULL,
    body   TEXT NOT NULL,
    at     TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
) STRICT;
CREATE INDEX event_by_job ON event (job_id, id);

CREATE TABLE idempotency (
    key         TEXT PRIMARY KEY,
    fingerprint TEXT NOT NULL,
    answer      TEXT NOT NULL,
    created_at  TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
) STRICT;

-- Events up to this number have been pruned, but for those of jobs that had not ended.
CREATE TABLE event_retention (
    only_row       INTEGER PRIMARY KEY CHECK (only_row = 1),
    pruned_through INTEGER NOT NULL
) STRICT;

CREATE TABLE spec_version (
    only_row INTEGER PRIMARY KEY CHECK (only_row = 1),
    last     INTEGER NOT NULL
) STRICT;
