"""Figures of experiments and campaigns; most are stages, cached like every other result."""

DRAWN = "pictures", "grains", "bed", "logs", "overlay", "overlays", "cone_film"
PICTURES = tuple(f"jumpvision.report.figures.{module}" for module in DRAWN)  # whose import registers figures as stages
