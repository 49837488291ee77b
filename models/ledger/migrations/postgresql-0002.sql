-- What a dispatcher has on its desk: orders, drones, flights, pads out of order, and the service itself, each as a document (JSON).
CREATE TABLE desk (
    dispatcher text NOT NULL,
    kind text NOT NULL,
    id text NOT NULL,
    version integer NOT NULL,
    state text NOT NULL,
    keeper text NOT NULL,
    document text NOT NULL,
    token bigint NOT NULL,
    PRIMARY KEY (dispatcher, kind, id)
);
CREATE INDEX desk_by_state ON desk (dispatcher, kind, state);
CREATE TRIGGER desk_stays BEFORE DELETE OR TRUNCATE ON desk FOR EACH STATEMENT EXECUTE FUNCTION only_appended_to();

CREATE TABLE desk_history (
    seq bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    at timestamptz NOT NULL,
    dispatcher text NOT NULL,
    kind text NOT NULL,
    id text NOT NULL,
    version integer NOT NULL,
    state text NOT NULL,
    keeper text NOT NULL,
    document text NOT NULL,
    token bigint NOT NULL
);
CREATE INDEX desk_history_of_one ON desk_history (dispatcher, kind, id, seq);

CREATE FUNCTION append_desk_history() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO desk_history (at, dispatcher, kind, id, version, state, keeper, document, token)
    VALUES (clock_timestamp(), NEW.dispatcher, NEW.kind, NEW.id, NEW.version, NEW.state, NEW.keeper, NEW.document, NEW.token);
    RETURN NULL;
END $$;
CREATE TRIGGER desk_put AFTER INSERT OR UPDATE ON desk FOR EACH ROW EXECUTE FUNCTION append_desk_history();
CREATE TRIGGER desk_history_stays BEFORE UPDATE OR DELETE OR TRUNCATE ON desk_history FOR EACH STATEMENT EXECUTE FUNCTION only_appended_to();
