"""What was done and what is in force: ledger, bundles, promotion, audit log, and MLflow (its only home)."""
