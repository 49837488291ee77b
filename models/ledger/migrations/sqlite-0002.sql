-- What a dispatcher has on its desk: orders, drones, flights, pads out of order, and the service itself, each as a document (JSON).
CREATE TABLE desk (
    dispatcher TEXT NOT NULL,
    kind TEXT NOT NULL,
    id TEXT NOT NULL,
    version INTEGER NOT NULL,
    state TEXT NOT NULL,
    keeper TEXT NOT NULL,
    document TEXT NOT NULL,
    token INTEGER NOT NULL,
    PRIMARY KEY (dispatcher, kind, id)
) STRICT;
CREATE INDEX desk_by_state ON desk (dispatcher, kind, state);

CREATE TRIGGER desk_stays BEFORE DELETE ON desk
BEGIN SELECT RAISE(ABORT, 'what is on the desk changes its state, and is not deleted'); END;

CREATE TABLE desk_history (
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    at INTEGER NOT NULL,
    dispatcher TEXT NOT NULL,
    kind TEXT NOT NULL,
    id TEXT NOT NULL,
    version INTEGER NOT NULL,
    state TEXT NOT NULL,
    keeper TEXT NOT NULL,
    document TEXT NOT NULL,
    token INTEGER NOT NULL
) STRICT;
CREATE INDEX desk_history_of_one ON desk_history (dispatcher, kind, id, seq);

CREATE TRIGGER desk_put AFTER INSERT ON desk
BEGIN
    INSERT INTO desk_history (at, dispatcher, kind, id, version, state, keeper, document, token)
    VALUES (CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000, NEW.dispatcher, NEW.kind, NEW.id, NEW.version, NEW.state,
            NEW.keeper, NEW.document, NEW.token);
END;
CREATE TRIGGER desk_changed AFTER UPDATE ON desk
BEGIN
    INSERT INTO desk_history (at, dispatcher, kind, id, version, state, keeper, document, token)
    VALUES (CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000, NEW.dispatcher, NEW.kind, NEW.id, NEW.version, NEW.state,
            NEW.keeper, NEW.document, NEW.token);
END;

CREATE TRIGGER desk_history_is_not_changed BEFORE UPDATE ON desk_history
BEGIN SELECT RAISE(ABORT, 'the history is only appended to'); END;
CREATE TRIGGER desk_history_is_not_deleted BEFORE DELETE ON desk_history
BEGIN SELECT RAISE(ABORT, 'the history is only appended to'); END;
