"""Files: machines, campaigns, and how every output is written (completely or not at all)."""

from volid.io.campaign.files import load_campaign
from volid.io.campaign.hdf5 import read_campaign, write_campaign
from volid.io.campaign.manifest import read_manifest, write_manifest
from volid.io.machines import format_machine, parse_machine, read_machine

__all__ = [
    "format_machine",
    "load_campaign",
    "parse_machine",
    "read_campaign",
    "read_machine",
    "read_manifest",
    "write_campaign",
    "write_manifest",
]
