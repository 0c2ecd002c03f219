"""The stages: records in, record out. Every module here is found, and run after those whose records it reads."""
