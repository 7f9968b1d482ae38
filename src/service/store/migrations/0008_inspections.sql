-- Scans that clients upload for a job, inspections of them, and the files of inspections. They go with their job.
CREATE TABLE scan (
    id         TEXT PRIMARY KEY,
    job_id     TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    sha256     TEXT NOT NULL,
    size_bytes INTEGER NOT NULL,
    body       TEXT NOT NULL,
    created_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
) STRICT;
CREATE INDEX scan_by_job ON scan (job_id, id);
CREATE INDEX scan_by_file ON scan (sha256);

CREATE TABLE inspection (
    id         TEXT PRIMARY KEY,
    job_id     TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    state      TEXT NOT NULL,
    body       TEXT NOT NULL,
    input      TEXT NOT NULL,
    created_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    ended_at   TEXT
) STRICT;
CREATE INDEX inspection_by_job ON inspection (job_id, id);
CREATE INDEX inspection_by_state ON inspection (state, id);

CREATE TABLE inspection_file (
    inspection_id TEXT NOT NULL REFERENCES inspection (id) ON DELETE CASCADE,
    name          TEXT NOT NULL,
    sha256        TEXT NOT NULL,
    size_bytes    INTEGER NOT NULL,
    file_sha256   TEXT NOT NULL,
    file_bytes    INTEGER NOT NULL,
    encoding      TEXT NOT NULL,
    PRIMARY KEY (inspection_id, name)
) STRICT;
CREATE INDEX inspection_file_by_file ON inspection_file (file_sha256);

-- Every reference of a row to a file of the store. A table that refers to files belongs here.
CREATE VIEW file_reference (sha256, bytes) AS
    SELECT sha256, size_bytes FROM mesh
    UNION ALL SELECT preview, 0 FROM mesh WHERE preview IS NOT NULL
    UNION ALL SELECT file_sha256, file_bytes FROM artifact
    UNION ALL SELECT sha256, size_bytes FROM scan
    UNION ALL SELECT file_sha256, file_bytes FROM inspection_file;
