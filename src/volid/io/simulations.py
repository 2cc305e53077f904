"""A simulated campaign with its truth beside it: both files are written, or none."""

from __future__ import annotations

from pathlib import Path

from volid.campaign import Campaign
from volid.exceptions import OutputError
from volid.io.basics.atomic import atomic_folder, atomic_with_companions
from volid.io.campaign.hdf5 import write_campaign
from volid.io.campaign.manifest import write_manifest
from volid.io.truths import write_truth
from volid.virtual.truth import Truth


def write_simulation(
    campaign: Campaign, truth: Truth, campaign_file: Path, truth_file: Path, overwrite: bool = False
) -> None:
    """Write a campaign, as HDF5 or as a manifest with its CSV files (`campaign_file` ends in .toml), and the truth beside it.

    Raises `OutputError` when a file exists (unless `overwrite`) or cannot be written; then neither is written.
    """
    text = campaign_file.suffix.lower() == ".toml"
    companions = atomic_with_companions(campaign_file, [truth_file.name], overwrite)
    with atomic_folder(campaign_file.parent, overwrite) if text else companions as folder:
        try:
            if text:
                write_manifest(campaign, folder)
            else:
                write_campaign(campaign, folder / campaign_file.name)
            write_truth(truth, folder / truth_file.name)
        except OutputError as error:  # it names the place where the files are until both are there
            raise OutputError(str(error).replace(str(folder), str(campaign_file.parent))) from None
