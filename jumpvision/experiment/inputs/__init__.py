"""What users bring: experiment folders, their sections and parameters, logs, and values given over them."""
