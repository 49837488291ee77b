-- The longest time that a window of a pad has counted for. What touches a new window closes within that time of its end: an hour or so, instead of
-- the 9 days that a window may count for at most.
ALTER TABLE pad ADD COLUMN longest INTEGER NOT NULL DEFAULT 0;
UPDATE pad SET longest = COALESCE((SELECT MAX(closes - opens) FROM booking WHERE pad_key = pad.key), 0);

CREATE TRIGGER longest_of_pad AFTER INSERT ON booking
BEGIN UPDATE pad SET longest = NEW.closes - NEW.opens WHERE key = NEW.pad_key AND longest < NEW.closes - NEW.opens; END;

DROP TRIGGER no_overlap;
CREATE TRIGGER no_overlap BEFORE INSERT ON booking
WHEN EXISTS (
    SELECT 1 FROM booking AS other
    WHERE other.pad_key = NEW.pad_key AND other.state <> 'released'
      AND other.closes > NEW.core_from AND other.closes < NEW.core_until + (SELECT longest FROM pad WHERE key = NEW.pad_key)
      AND other.core_from < NEW.core_until AND other.core_until > NEW.core_from
      AND other.core_from < other.core_until AND NEW.core_from < NEW.core_until
)
BEGIN SELECT RAISE(ABORT, 'taken'); END;
