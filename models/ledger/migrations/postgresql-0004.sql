-- The longest time that a window of a pad has counted for. What touches a new window closes within that time of its end: an hour or so, instead of
-- the 9 days that a window may count for at most. In hours, not days: a day of a time zone may have 23 or 25 of them.
ALTER TABLE pad ADD COLUMN longest interval NOT NULL DEFAULT interval '0';
UPDATE pad SET longest = COALESCE((SELECT make_interval(secs => EXTRACT(EPOCH FROM MAX(closes - opens))::float8) FROM booking WHERE pad_key = pad.key), interval '0');

CREATE FUNCTION longest_of_pad() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE pad SET longest = found.longest
    FROM (SELECT pad_key, make_interval(secs => EXTRACT(EPOCH FROM MAX(closes - opens))::float8) AS longest FROM now GROUP BY pad_key) AS found
    WHERE pad.key = found.pad_key AND pad.longest < found.longest;
    RETURN NULL;
END $$;
CREATE TRIGGER longest_of_pad AFTER INSERT ON booking REFERENCING NEW TABLE AS now FOR EACH STATEMENT EXECUTE FUNCTION longest_of_pad();
