-- Instants are microseconds since 1970 UTC, by the clock of the database.
CREATE TABLE lease (
    holder TEXT PRIMARY KEY,
    token INTEGER NOT NULL,
    owner TEXT NOT NULL,
    expires INTEGER NOT NULL
) STRICT;

CREATE TABLE pad (
    key INTEGER PRIMARY KEY,
    station TEXT NOT NULL,
    number INTEGER NOT NULL CHECK (number >= 1),
    UNIQUE (station, number)
) STRICT;

CREATE TABLE itinerary (
    id TEXT PRIMARY KEY,
    version INTEGER NOT NULL,
    holder TEXT NOT NULL
) STRICT;

CREATE TABLE booking (
    id INTEGER PRIMARY KEY,
    itinerary TEXT NOT NULL,
    version INTEGER NOT NULL,
    number INTEGER NOT NULL,
    station TEXT NOT NULL,
    pad INTEGER NOT NULL,
    pad_key INTEGER NOT NULL REFERENCES pad (key),
    starts INTEGER NOT NULL,
    ends INTEGER NOT NULL,
    opens INTEGER NOT NULL,
    closes INTEGER NOT NULL,
    core_from INTEGER NOT NULL,
    core_until INTEGER NOT NULL,
    start_sd_s REAL NOT NULL,
    end_sd_s REAL NOT NULL,
    epsilon REAL NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('tentative', 'firm', 'in use', 'late', 'released')),
    holder TEXT NOT NULL,
    token INTEGER NOT NULL,
    changed_by TEXT,
    UNIQUE (itinerary, version, number),
    CHECK (starts < ends AND opens <= starts AND ends <= closes AND core_from <= core_until)
) STRICT;

CREATE INDEX booking_of_pad ON booking (pad_key, closes) WHERE state <> 'released';
CREATE UNIQUE INDEX one_in_use ON booking (pad_key) WHERE state = 'in use';

CREATE TRIGGER no_overlap BEFORE INSERT ON booking
WHEN EXISTS (
    SELECT 1 FROM booking AS other
    WHERE other.pad_key = NEW.pad_key AND other.state <> 'released' AND other.closes > NEW.core_from
      AND other.core_from < NEW.core_until AND other.core_until > NEW.core_from
      AND other.core_from < other.core_until AND NEW.core_from < NEW.core_until
)
BEGIN SELECT RAISE(ABORT, 'taken'); END;

CREATE TRIGGER only_the_state_changes BEFORE UPDATE ON booking
WHEN (NEW.id, NEW.itinerary, NEW.version, NEW.number, NEW.pad_key, NEW.starts, NEW.ends, NEW.core_from, NEW.core_until, NEW.epsilon)
  IS NOT (OLD.id, OLD.itinerary, OLD.version, OLD.number, OLD.pad_key, OLD.starts, OLD.ends, OLD.core_from, OLD.core_until, OLD.epsilon)
  OR OLD.state = 'released'
BEGIN SELECT RAISE(ABORT, 'a booking changes its state alone, and not once it is released'); END;

CREATE TRIGGER bookings_stay BEFORE DELETE ON booking
BEGIN SELECT RAISE(ABORT, 'bookings are released, not deleted'); END;

CREATE TABLE history (
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    at INTEGER NOT NULL,
    itinerary TEXT NOT NULL,
    version INTEGER NOT NULL,
    number INTEGER NOT NULL,
    station TEXT NOT NULL,
    pad INTEGER NOT NULL,
    starts INTEGER NOT NULL,
    ends INTEGER NOT NULL,
    start_sd_s REAL NOT NULL,
    end_sd_s REAL NOT NULL,
    epsilon REAL NOT NULL,
    state TEXT NOT NULL,
    holder TEXT NOT NULL,
    token INTEGER NOT NULL
) STRICT;
CREATE INDEX history_of_itinerary ON history (itinerary, seq);

CREATE TRIGGER booked AFTER INSERT ON booking
BEGIN
    INSERT INTO history (at, itinerary, version, number, station, pad, starts, ends, start_sd_s, end_sd_s, epsilon, state, holder, token)
    VALUES (CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000, NEW.itinerary, NEW.version, NEW.number, NEW.station,
            NEW.pad, NEW.starts, NEW.ends, NEW.start_sd_s, NEW.end_sd_s, NEW.epsilon, NEW.state, NEW.holder, NEW.token);
END;
CREATE TRIGGER changed AFTER UPDATE OF state ON booking
BEGIN
    INSERT INTO history (at, itinerary, version, number, station, pad, starts, ends, start_sd_s, end_sd_s, epsilon, state, holder, token)
    VALUES (CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000, NEW.itinerary, NEW.version, NEW.number, NEW.station,
            NEW.pad, NEW.starts, NEW.ends, NEW.start_sd_s, NEW.end_sd_s, NEW.epsilon, NEW.state, COALESCE(NEW.changed_by, NEW.holder),
            NEW.token);
END;

CREATE TRIGGER history_is_not_changed BEFORE UPDATE ON history
BEGIN SELECT RAISE(ABORT, 'the history is only appended to'); END;
CREATE TRIGGER history_is_not_deleted BEFORE DELETE ON history
BEGIN SELECT RAISE(ABORT, 'the history is only appended to'); END;
