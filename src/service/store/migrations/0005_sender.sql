-- Name of the key with which a job was submitted; jobs from before have none.
ALTER TABLE job ADD COLUMN submitted_by TEXT;

-- Warnings on what was accepted, so that lists have them without the job's body.
ALTER TABLE job ADD COLUMN warnings TEXT;
UPDATE job SET warnings = (SELECT CASE WHEN json_valid(input) THEN input -> '$.warnings' END FROM job_body WHERE job_id = job.id);
