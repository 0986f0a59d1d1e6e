"""MCAP files, record by record: written, scanned, closed on a full disk."""
