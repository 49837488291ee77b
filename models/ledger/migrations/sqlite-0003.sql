-- No window counts for more than 9 days (a week, and four standard deviations of 6 h at each end), so that what touches a new one closes within
-- 9 days of its end: before, all that was booked for later was looked through.
DROP TRIGGER no_overlap;
CREATE TRIGGER no_overlap BEFORE INSERT ON booking
WHEN EXISTS (
    SELECT 1 FROM booking AS other
    WHERE other.pad_key = NEW.pad_key AND other.state <> 'released'
      AND other.closes > NEW.core_from AND other.closes < NEW.core_until + 777600000000
      AND other.core_from < NEW.core_until AND other.core_until > NEW.core_from
      AND other.core_from < other.core_until AND NEW.core_from < NEW.core_until
)
BEGIN SELECT RAISE(ABORT, 'taken'); END;
