"""From pixels to positions: balls, foot, bed, laser line, and the matching of grain films."""
