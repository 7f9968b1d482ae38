-- Summary of the plan of a job that succeeded, apart from the job's row: filters and progress never touch it. Jobs that ended before
-- have none.
CREATE TABLE job_summary (
    job_id  TEXT PRIMARY KEY REFERENCES job (id) ON DELETE CASCADE,
    summary TEXT NOT NULL
) STRICT;
