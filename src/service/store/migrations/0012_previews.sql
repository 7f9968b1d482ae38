-- Sizes of previews, which took room that nothing counted. Those of earlier releases are drawn again when they are asked for.
ALTER TABLE mesh ADD COLUMN preview_bytes INTEGER NOT NULL DEFAULT 0;
UPDATE mesh SET preview = NULL;

DROP VIEW file_reference;
-- Every reference of a row to a file of the store. A table that refers to files belongs here.
CREATE VIEW file_reference (sha256, bytes) AS
    SELECT sha256, size_bytes FROM mesh
    UNION ALL SELECT preview, preview_bytes FROM mesh WHERE preview IS NOT NULL
    UNION ALL SELECT sha256, size_bytes FROM job_mesh WHERE sha256 <> ''
    UNION ALL SELECT file_sha256, file_bytes FROM artifact
    UNION ALL SELECT sha256, size_bytes FROM scan
    UNION ALL SELECT file_sha256, file_bytes FROM inspection_file;
