"""What every floor above stands on: declared values, whole files, progress, processes, numbers for people."""
