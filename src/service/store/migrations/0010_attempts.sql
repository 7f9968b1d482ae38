-- Number of processes that died while they computed an inspection or a calibration.
ALTER TABLE inspection ADD COLUMN attempts INTEGER NOT NULL DEFAULT 0;
ALTER TABLE calibration ADD COLUMN attempts INTEGER NOT NULL DEFAULT 0;
