-- Calibrations: the resource, the order that it was computed from, and its result.
CREATE TABLE calibration (
    id         TEXT PRIMARY KEY,
    cell       TEXT NOT NULL,
    state      TEXT NOT NULL,
    body       TEXT NOT NULL,
    input      TEXT NOT NULL,
    result     TEXT,
    created_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    ended_at   TEXT
) STRICT;
CREATE INDEX calibration_by_state ON calibration (state, id);
CREATE INDEX calibration_by_cell ON calibration (cell, id);
