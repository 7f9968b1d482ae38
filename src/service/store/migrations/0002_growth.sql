-- What a job was asked for and is planned with, apart from how it stands: lists and progress never touch it.
CREATE TABLE job_body (
    job_id  TEXT PRIMARY KEY REFERENCES job (id) ON DELETE CASCADE,
    version INTEGER NOT NULL,
    request TEXT NOT NULL,
    input   TEXT NOT NULL
) STRICT;
INSERT INTO job_body SELECT id, 1, request, input FROM job;

-- Names for lists. A row whose request cannot be read keeps empty ones.
ALTER TABLE job ADD COLUMN serial TEXT;
ALTER TABLE job ADD COLUMN cell TEXT NOT NULL DEFAULT '';
ALTER TABLE job ADD COLUMN scanner TEXT NOT NULL DEFAULT '';
UPDATE job SET
    serial = CAST(request ->> '$.serial' AS TEXT),
    cell = coalesce(CAST(CASE json_type(request, '$.cell')
        WHEN 'object' THEN request ->> '$.cell.name' ELSE request ->> '$.cell' END AS TEXT), ''),
    scanner = coalesce(CAST(CASE json_type(request, '$.scanner')
        WHEN 'object' THEN request ->> '$.scanner.name' ELSE request ->> '$.scanner' END AS TEXT), '')
    WHERE json_valid(request);
ALTER TABLE job DROP COLUMN request;
ALTER TABLE job DROP COLUMN input;

CREATE TABLE job_label (
    key    TEXT NOT NULL,
    value  TEXT NOT NULL,
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    PRIMARY KEY (key, value, job_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_label_by_key ON job_label (key, job_id);
CREATE INDEX job_label_by_job ON job_label (job_id);
INSERT INTO job_label (key, value, job_id)
    SELECT label.key, label.value, job.id
    FROM job, json_each(CASE WHEN json_valid(job.labels) THEN job.labels ELSE '{}' END) AS label
    WHERE label.type = 'text';

CREATE INDEX job_by_state ON job (state, id);
CREATE INDEX job_by_part ON job (part_number, id) WHERE part_number IS NOT NULL;
CREATE INDEX job_by_mesh ON job (mesh_id, id);
CREATE INDEX job_by_end ON job (ended_at) WHERE ended_at IS NOT NULL;
CREATE INDEX idempotency_by_age ON idempotency (created_at);

-- The file that holds a result, which may be compressed; `sha256` and `size_bytes` stay those of the result itself.
ALTER TABLE artifact ADD COLUMN file_sha256 TEXT NOT NULL DEFAULT '';
ALTER TABLE artifact ADD COLUMN file_bytes INTEGER NOT NULL DEFAULT 0;
ALTER TABLE artifact ADD COLUMN encoding TEXT NOT NULL DEFAULT 'identity';
UPDATE artifact SET file_sha256 = sha256, file_bytes = size_bytes;
DROP INDEX artifact_by_file;
CREATE INDEX artifact_by_file ON artifact (file_sha256);
CREATE INDEX mesh_by_preview ON mesh (preview) WHERE preview IS NOT NULL;

-- Which store this is; the folder has the same id in a file of its own, so that a database beside the files of another
-- store is noticed.
CREATE TABLE store (
    only_row INTEGER PRIMARY KEY CHECK (only_row = 1),
    id       TEXT NOT NULL
) STRICT;
INSERT INTO store VALUES (1, lower(hex(randomblob(16))));
