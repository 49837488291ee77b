"""The ledger: who holds which pad when, kept in SQLite or PostgreSQL."""
