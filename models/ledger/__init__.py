"""The ledger: which holder has which pad when, in SQLite or PostgreSQL."""
