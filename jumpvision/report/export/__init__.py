"""Results for other programs: tables as CSV, fields as VTK, everything as an RO-Crate."""
