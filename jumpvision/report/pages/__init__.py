"""report.html: pages without network, with the figures to point at."""
