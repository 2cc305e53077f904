"""The picture of the README, from the bundled campaign: `.venv/bin/python docs/images/make.py`."""

import io
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent / "figures"))

from _field import field_figure  # noqa: E402
from PIL import Image  # noqa: E402

import volid  # noqa: E402

campaign = volid.load_campaign(ROOT / "datasets" / "vertical_multilateration" / "campaign.toml")
figure = field_figure(volid.fit(campaign), ([], ["L-POS"], ["L-VOL"]))
drawn = io.BytesIO()
figure.savefig(drawn, format="png", dpi=130)
Image.open(drawn).convert("RGB").quantize(128).save(HERE / "field.png", optimize=True)
