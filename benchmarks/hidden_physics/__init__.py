"""Hidden physics: 240 campaigns whose models lack something, or nothing; anybody's method can enter.

    python -m benchmarks.hidden_physics seal --seed N            hash of all truths, published before any answer
    python -m benchmarks.hidden_physics run ENTRY --rows FILE    an entry's answers, one JSON line a campaign
    python -m benchmarks.hidden_physics score --rows FILE        its table, failures included, worst row first

ENTRY is `ours`, `least_squares` or MODULE:NAME, a function from a Task to an Answer (entries.py has both types and the
adapters; neither is longer than 30 lines). Options: --seed, --only TEXT (of the kind), --cases A:B, --workers.
"""
