"""Laboratories at fault: 244 campaigns in which a recording, a day, an order or an apparatus is wrong, not a force.

    python -m benchmarks.laboratories seal --seed N             hash of all truths, published before any answer
    python -m benchmarks.laboratories run --rows FILE           the answers, one JSON line a campaign, and their table
    python -m benchmarks.laboratories score --rows FILE         the table again; --shuffled: answers dealt out anew

120 campaigns of ten kinds of fault, 24 with a force law of the vocabulary beside one, 60 in which one parameter really
scatters, 40 of plain causes. Options: --seed, --only TEXT (of part or kind), --cases A:B, --workers.
"""
