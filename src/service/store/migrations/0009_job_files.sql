-- The files of the meshes that a job read: they stay as long as the job, for its inspections and runs, also where the mesh itself is
-- deleted. Rows of meshes that were deleted before name no file.
ALTER TABLE job_mesh ADD COLUMN sha256 TEXT NOT NULL DEFAULT '';
ALTER TABLE job_mesh ADD COLUMN size_bytes INTEGER NOT NULL DEFAULT 0;
UPDATE job_mesh SET (sha256, size_bytes) = (SELECT sha256, size_bytes FROM mesh WHERE id = mesh_id)
    WHERE EXISTS (SELECT 1 FROM mesh WHERE id = mesh_id);
CREATE INDEX job_mesh_by_file ON job_mesh (sha256) WHERE sha256 <> '';

DROP VIEW file_reference;
-- Every reference of a row to a file of the store. A table that refers to files belongs here.
CREATE VIEW file_reference (sha256, bytes) AS
    SELECT sha256, size_bytes FROM mesh
    UNION ALL SELECT preview, 0 FROM mesh WHERE preview IS NOT NULL
    UNION ALL SELECT sha256, size_bytes FROM job_mesh WHERE sha256 <> ''
    UNION ALL SELECT file_sha256, file_bytes FROM artifact
    UNION ALL SELECT sha256, size_bytes FROM scan
    UNION ALL SELECT file_sha256, file_bytes FROM inspection_file;
