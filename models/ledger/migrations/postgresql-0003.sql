-- Versions of both stores go together; the constraint of this one needs no change.
COMMENT ON CONSTRAINT no_overlap ON booking IS 'two cores of one pad do not overlap';
