-- Filters and orders of lists of jobs.
CREATE INDEX job_by_serial ON job (serial, id) WHERE serial IS NOT NULL;
CREATE INDEX job_by_cell ON job (cell, id);
CREATE INDEX job_by_creation ON job (created_at, id);

-- A job that has not ended stands after all times; one without a number before all numbers.
CREATE INDEX job_in_order_of_end ON job (coalesce(ended_at, '~'), id);
CREATE INDEX job_in_order_of_part ON job (coalesce(part_number, ''), id);
CREATE INDEX job_in_order_of_serial ON job (coalesce(serial, ''), id);
