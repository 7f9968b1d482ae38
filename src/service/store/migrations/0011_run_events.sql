-- Events of runs up to this number have been pruned, but for those of runs that had not ended. What was pruned before this table was
-- made is taken to reach to the last gap in the numbers.
CREATE TABLE run_event_retention (
    only_row       INTEGER PRIMARY KEY CHECK (only_row = 1),
    pruned_through INTEGER NOT NULL
) STRICT;
INSERT INTO run_event_retention SELECT 1, CASE
    WHEN coalesce((SELECT max(id) FROM run_event), 0) < coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'run_event'), 0)
    THEN (SELECT seq FROM sqlite_sequence WHERE name = 'run_event')
    ELSE coalesce(
        (SELECT max(id) - 1 FROM run_event AS event WHERE NOT EXISTS (SELECT 1 FROM run_event WHERE id = event.id - 1)), 0)
END;
