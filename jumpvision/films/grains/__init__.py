"""What a velocity field of grains says: strain, bands, momentum, jammed front, column and cone under the foot."""
