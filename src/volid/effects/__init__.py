"""Types of systematic effects: one file each; this table is the only place that knows them all."""

from volid.effects.base import EffectType
from volid.effects.drift import DRIFT
from volid.effects.offset import OFFSET
from volid.effects.repeatability import REPEATABILITY
from volid.effects.scale import SCALE
from volid.effects.temperature import TEMPERATURE
from volid.effects.tool_length import TOOL_LENGTH

TYPES: dict[str, EffectType] = {
    effect.name: effect for effect in (SCALE, OFFSET, DRIFT, TOOL_LENGTH, REPEATABILITY, TEMPERATURE)
}

__all__ = ["TYPES", "EffectType"]
