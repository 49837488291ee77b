CREATE TABLE lease (
    holder text PRIMARY KEY,
    token bigint NOT NULL,
    owner text NOT NULL,
    expires timestamptz NOT NULL
);

CREATE TABLE pad (
    key integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    station text NOT NULL,
    number integer NOT NULL CHECK (number >= 1),
    UNIQUE (station, number)
);

CREATE TABLE itinerary (
    id text PRIMARY KEY,
    version integer NOT NULL,
    holder text NOT NULL
);

CREATE TABLE booking (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    itinerary text NOT NULL,
    version integer NOT NULL,
    number integer NOT NULL,
    station text NOT NULL,
    pad integer NOT NULL,
    pad_key integer NOT NULL REFERENCES pad (key),
    starts timestamptz NOT NULL,
    ends timestamptz NOT NULL,
    opens timestamptz NOT NULL,
    closes timestamptz NOT NULL,
    core_from timestamptz NOT NULL,
    core_until timestamptz NOT NULL,
    start_sd_s double precision NOT NULL,
    end_sd_s double precision NOT NULL,
    epsilon double precision NOT NULL,
    state text NOT NULL CHECK (state IN ('tentative', 'firm', 'in use', 'late', 'released')),
    holder text NOT NULL,
    token bigint NOT NULL,
    changed_by text,
    -- The whole pad as a range, so that the constraint needs no extension; an empty core excludes nothing.
    pads int4range GENERATED ALWAYS AS (int4range(pad_key, pad_key, '[]')) STORED,
    during tstzrange GENERATED ALWAYS AS (tstzrange(core_from, core_until, '[)')) STORED,
    UNIQUE (itinerary, version, number),
    CHECK (starts < ends AND opens <= starts AND ends <= closes AND core_from <= core_until),
    CONSTRAINT no_overlap EXCLUDE USING gist (pads WITH &&, during WITH &&) WHERE (state <> 'released')
);

CREATE INDEX booking_of_pad ON booking (pad_key, closes) WHERE state <> 'released';
CREATE UNIQUE INDEX one_in_use ON booking (pad_key) WHERE state = 'in use';

CREATE TABLE history (
    seq bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    at timestamptz NOT NULL,
    itinerary text NOT NULL,
    version integer NOT NULL,
    number integer NOT NULL,
    station text NOT NULL,
    pad integer NOT NULL,
    starts timestamptz NOT NULL,
    ends timestamptz NOT NULL,
    start_sd_s double precision NOT NULL,
    end_sd_s double precision NOT NULL,
    epsilon double precision NOT NULL,
    state text NOT NULL,
    holder text NOT NULL,
    token bigint NOT NULL
);
CREATE INDEX history_of_itinerary ON history (itinerary, seq);

-- Once for a statement, since a booking has several windows.
CREATE FUNCTION append_history() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO history (at, itinerary, version, number, station, pad, starts, ends, start_sd_s, end_sd_s, epsilon, state, holder, token)
    SELECT clock_timestamp(), itinerary, version, number, station, pad, starts, ends, start_sd_s, end_sd_s, epsilon, state,
           COALESCE(changed_by, holder), token
    FROM now ORDER BY id;
    RETURN NULL;
END $$;
CREATE TRIGGER booked AFTER INSERT ON booking REFERENCING NEW TABLE AS now FOR EACH STATEMENT EXECUTE FUNCTION append_history();
CREATE TRIGGER changed AFTER UPDATE ON booking REFERENCING NEW TABLE AS now FOR EACH STATEMENT EXECUTE FUNCTION append_history();

CREATE FUNCTION only_the_state_changes() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF OLD.state = 'released' OR
       (NEW.id, NEW.itinerary, NEW.version, NEW.number, NEW.pad_key, NEW.starts, NEW.ends, NEW.core_from, NEW.core_until, NEW.epsilon)
       IS DISTINCT FROM
       (OLD.id, OLD.itinerary, OLD.version, OLD.number, OLD.pad_key, OLD.starts, OLD.ends, OLD.core_from, OLD.core_until, OLD.epsilon)
    THEN RAISE EXCEPTION 'a booking changes its state alone, and not once it is released';
    END IF;
    RETURN NEW;
END $$;
CREATE TRIGGER only_the_state_changes BEFORE UPDATE ON booking FOR EACH ROW EXECUTE FUNCTION only_the_state_changes();

CREATE FUNCTION only_appended_to() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'bookings and their history are only appended to';
END $$;
CREATE TRIGGER bookings_stay BEFORE DELETE OR TRUNCATE ON booking FOR EACH STATEMENT EXECUTE FUNCTION only_appended_to();
CREATE TRIGGER history_stays BEFORE UPDATE OR DELETE OR TRUNCATE ON history FOR EACH STATEMENT EXECUTE FUNCTION only_appended_to();
