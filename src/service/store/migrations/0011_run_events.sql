-- Events of runs up to this number have been pruned, but for those of runs that had not ended. What was pruned before this table was
-- made had numbers below the first that is left.
CREATE TABLE run_event_retention (
    only_row       INTEGER PRIMARY KEY CHECK (only_row = 1),
    pruned_through INTEGER NOT NULL
) STRICT;
INSERT INTO run_event_retention
    SELECT 1, coalesce((SELECT min(id) - 1 FROM run_event), (SELECT seq FROM sqlite_sequence WHERE name = 'run_event'), 0);
