"""Files of this field that their own libraries read otherwise than they were written. Truth: what was written."""

from __future__ import annotations

import av
import numpy as np
import pytest

from jumpvision.films.frames import open_frames


@pytest.mark.surprise(
    package="av",
    version="18.1.0",
    behaviour="A lossless grey film of H.264 comes as yuv420p of unstated range: to_ndarray(format='gray'), imageio "
    "and OpenCV make 0..16 black, 235..255 white and stretch the rest by 255/219.",
    here="Grey is the stored luma, as it was written.",
)
def test_a_grey_film_of_h264_keeps_its_darks(tmp_path):
    """Every grey once; exact, as qp 0 is lossless."""
    ramp, path = np.tile(np.arange(256, dtype=np.uint8), (48, 1)), tmp_path / "grey.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=1000, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = 256, 48, "gray"
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(ramp, format="gray")))
        container.mux(stream.encode())
    with open_frames(path) as film:
        assert film.meta["bit_depth"] == 8
        assert all(np.array_equal(image, ramp) for image in film)
