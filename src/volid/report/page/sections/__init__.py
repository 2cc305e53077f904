"""The sections of the page, in a metrologist's order: each module has `build(contents, texts) -> Section | None`."""

ORDER = (
    "verdict",
    "machine",
    "campaign",
    "stations",
    "functions",
    "constants",
    "field",
    "compensation",
    "limits",
    "residuals",
    "not_determined",
    "budget",
    "provenance",
)
