-- Runs of programs. A run keeps the id of its job, which may be deleted before it.
CREATE TABLE run (
    id         TEXT PRIMARY KEY,
    job_id     TEXT,
    cell       TEXT NOT NULL,
    mode       TEXT NOT NULL,
    state      TEXT NOT NULL,
    body       TEXT NOT NULL,
    created_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    ended_at   TEXT
) STRICT;
CREATE INDEX run_by_state ON run (state, id);
CREATE INDEX run_by_cell ON run (cell, id);
CREATE INDEX run_by_job ON run (job_id, id);
CREATE INDEX run_by_creation ON run (created_at, id);

-- Record of a run, a row for each step that was completed.
CREATE TABLE run_step (
    run_id TEXT NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    number INTEGER NOT NULL,
    body   TEXT NOT NULL,
    PRIMARY KEY (run_id, number)
) STRICT, WITHOUT ROWID;

-- AUTOINCREMENT: a number is never given twice.
CREATE TABLE run_event (
    id     INTEGER PRIMARY KEY AUTOINCREMENT,
    run_id TEXT NOT NULL,
    body   TEXT NOT NULL,
    at     TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
) STRICT;
CREATE INDEX run_event_by_run ON run_event (run_id, id);

-- Programs that were completed live, in a cell as it was then: later runs of the same may be faster than the first.
CREATE TABLE run_completed (
    program_sha256 TEXT NOT NULL,
    cell_sha256    TEXT NOT NULL,
    PRIMARY KEY (program_sha256, cell_sha256)
) STRICT, WITHOUT ROWID;

-- The highest fencing token that was ever given.
CREATE TABLE run_fence (
    only_row INTEGER PRIMARY KEY CHECK (only_row = 1),
    last     INTEGER NOT NULL
) STRICT;
INSERT INTO run_fence VALUES (1, 0);
