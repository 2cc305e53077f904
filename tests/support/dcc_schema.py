"""What schema 3.3.0 of digital calibration certificates and D-SI 2.2.1 demand of the elements that volid writes.

Children in their order, how often each may stand, and the form of texts. Written from the published schemas, for places where
they cannot be had. `CONTENT`: type: children as "name:type" with ? (at most once), * (any number), + (once or more); `CHOICE`:
types whose children may stand in any order and number; `FORMS`: regular expressions of texts; `ATTRIBUTES`: what an element has.
"""

import re
import xml.etree.ElementTree as ET

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
# what a certificate asks for and a solution does not know, by the names that volid gives them, in their order
ASKED = (
    "country",
    "identifier",
    "begin",
    "end",
    "place",
    "laboratory",
    "customer",
    "person",
    "serial_number",
    "instrument",
)
MIXED = " name:text? description:rich?"
CHARGES = (
    " usedMethods:methods? usedSoftware:softwares? measuringEquipments:equipments? influenceConditions:conditions? "
    "measurementMetaData:metas?"
)
ALTERNATIVES = (
    "noQuantity:rich? charsXMLList:any? si.real:real? si.hybrid:hybrid? si.constant:any? si.realListXMLList:reals?"
)
CONTENT = {
    "certificate": "administrativeData:administrative measurementResults:measurementResults comment:any? document:any?",
    "administrative": "dccSoftware:softwares refTypeDefinitions:any? coreData:core items:items calibrationLaboratory:laboratory "
    "respPersons:persons customer:contact statements:statements?",  # the schema has them in any order
    "softwares": "software:software+",
    "software": "name:text release:line type:softwareType? description:rich?",
    "core": "countryCodeISO3166_1:country usedLangCodeISO639_1:language+ mandatoryLangCodeISO639_1:language+ "
    "uniqueIdentifier:line identifications:identifications? receiptDate:date? beginPerformanceDate:date "
    "endPerformanceDate:date performanceLocation:place issueDate:date? reportAmendedSubstituted:any? previousReport:any?",
    "items": MIXED.strip() + " owner:contact? manufacturer:loose? identifications:identifications? item:item+",
    "item": "name:text equipmentClass:any* description:rich? owner:contact? installedSoftwares:softwares? manufacturer:loose? "
    "model:line? identifications:identifications itemQuantities:any? subItems:items?",
    "identifications": "identification:identification+",
    "identification": "issuer:issuer value:line name:text?",
    "laboratory": "calibrationLaboratoryCode:line? contact:contact",
    "persons": "respPerson:respPerson+",
    "respPerson": "person:loose description:rich? role:line? mainSigner:boolean?",
    "contact": "name:text eMail:line? phone:line? fax:line? link:line? location:location descriptionData:any?",
    "loose": "name:text eMail:line? phone:line? fax:line? link:line? location:location? descriptionData:any?",
    "statements": "statement:statement+",
    "metas": "metaData:statement+",
    "statement": MIXED.strip() + " countryCodeISO3166_1:country* convention:line? traceable:boolean? norm:line* reference:line* "
    "link:line* declaration:rich? valid:boolean? date:date? period:line? respAuthority:contact? conformity:conformity? "
    "data:data? nonSIDefinition:line? nonSIUnit:line? location:location?",
    "measurementResults": "usedMethods:methods? usedSoftware:softwares? measuringEquipments:equipments? "
    "influenceConditions:conditions? measurementMetaData:metas? measurementResult:measurementResult+",
    "measurementResult": "name:text description:rich? usedMethods:methods? usedSoftware:softwares? "
    "measuringEquipments:equipments? influenceConditions:conditions? results:results measurementMetaData:metas?",
    "methods": "usedMethod:method+",
    "method": "name:text description:rich? norm:line* reference:line* link:line* usedMethodQuantities:any?",
    "equipments": "name:text? equipmentClass:any* description:rich? owner:contact? identifications:identifications? "
    "measuringEquipment:equipment+",
    "equipment": "name:text equipmentClass:any* description:rich? certificate:any? manufacturer:loose? model:line? "
    "identifications:identifications? measuringEquipmentQuantities:any? installedSoftware:softwares?",
    "conditions": "influenceCondition:condition+",
    "condition": "name:text description:rich? status:line? certificate:any? data:data",
    "results": "result:result+",
    "result": "name:text description:rich? data:data",
    "list": MIXED.strip() + " dateTime:line? quantity:quantity+" + CHARGES,  # lists within lists are not written
    "quantity": MIXED.strip() + f" {ALTERNATIVES} relativeUncertainty:any?" + CHARGES,
    "text": "content:content+",
    "rich": "name:text? content:content*",
    "hybrid": "si.real:real+",
    "real": "si.label:line? si.quantityTypeQUDT:line? si.value:decimal si.unit:unit si.significantDigit:line? si.dateTime:line? "
    "si.measurementUncertaintyUnivariate:uncertain?",
    "uncertain": "si.expandedMU:expanded",
    "expanded": "si.valueExpandedMU:decimal si.coverageFactor:decimal si.coverageProbability:decimal si.distribution:line?",
    "reals": "si.labelXMLList:line? si.quantityTypeQUDTXMLList:line? si.valueXMLList:decimals si.unitXMLList:unit "
    "si.significantDigitXMLList:line? si.dateTimeXMLList:line? si.measurementUncertaintyUnivariateXMLList:uncertains?",
    "uncertains": "si.expandedMUXMLList:expandeds? si.coverageIntervalMUXMLList:intervals?",
    "expandeds": "si.valueExpandedMUXMLList:decimals si.coverageFactorXMLList:decimals si.coverageProbabilityXMLList:decimals "
    "si.distributionXMLList:line?",
    "intervals": "si.valueStandardMUXMLList:decimals si.intervalMinXMLList:decimals si.intervalMaxXMLList:decimals "
    "si.coverageProbabilityXMLList:decimals si.distributionXMLList:line?",
}  # fmt: skip
CHOICE = {
    "data": "text:rich quantity:quantity list:list",
    "location": "city:line countryCode:country postCode:line street:line streetNo:line further:rich",
}
FORMS = {
    "line": r"\S+(\s+\S+)*", "content": r"(?s).+", "country": "[A-Z]{2}", "language": "[a-z]{2}", "date": r"\d{4}-\d\d-\d\d",
    "boolean": "true|false", "decimal": r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?",
    "decimals": r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?( [-+]?\d+(\.\d+)?([eE][-+]?\d+)?)*", "unit": r"(\\[a-z]+)+",
    "softwareType": "application|bios|driver|editor|firmware|library|os|other",
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    "place": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
}  # fmt: skip
ATTRIBUTES = {"id", "refId", "refType"}


def violations(root: ET.Element) -> list[str]:
    """Every place where a certificate is not as the schema has it; none for a valid one."""
    found = [] if root.tag == f"{DCC}digitalCalibrationCertificate" else [f"the root is {root.tag}"]
    found += [] if root.get("schemaVersion") == "3.3.0" else ["schemaVersion"]
    return found + violations_of(root, "certificate")


def violations_of(element: ET.Element, kind: str) -> list[str]:
    """The same for a part of a certificate, a type of `CONTENT`."""
    return _of(element, kind, kind)


def _of(element, kind, where):
    attributes = set(element.attrib) - ATTRIBUTES
    if kind == "content":
        attributes -= {"lang"}
    if kind == "certificate":
        attributes = set()
    found = [f"{where}: attribute {name}" for name in attributes]
    if kind == "any":
        return [f"{where}: not expected to be written"]
    if kind in FORMS:
        good = re.fullmatch(FORMS[kind], element.text or "") and not len(element)
        return found if good else [*found, f"{where}: {element.text!r} is no {kind}"]
    if (element.text or "").strip():
        found.append(f"{where}: text {element.text!r}")
    return found + (_in_choice(element, kind, where) if kind in CHOICE else _in_order(element, kind, where))


def _in_choice(element, kind, where):
    types = dict(entry.split(":") for entry in CHOICE[kind].split())
    found = [] if len(element) else [f"{where}: empty"]
    for child in element:
        name = _short(child.tag)
        found += _of(child, types[name], f"{where}/{name}") if name in types else [f"{where}: {name}"]
    return found


def _in_order(element, kind, where):
    entries = [re.fullmatch(r"([\w.]+):(\w+)([?*+]?)", entry).groups() for entry in CONTENT[kind].split()]
    pattern = "".join(f"(?:{re.escape(name)},){count}" for name, _, count in entries)
    names = [_short(child.tag) for child in element]
    found = []
    if not re.fullmatch(pattern, "".join(f"{name}," for name in names)):
        found.append(f"{where}: children {names}; expected {CONTENT[kind]}")
    if (
        kind in ("quantity", "uncertains")
        and sum(f"{name}:" in ALTERNATIVES + CONTENT["uncertains"] for name in names) != 1
    ):
        found.append(f"{where}: one of the alternatives, not {names}")
    types = {name: child_kind for name, child_kind, _ in entries}
    for name, child in zip(names, element, strict=True):
        found += _of(child, types[name], f"{where}/{name}") if name in types else []
    return found


def _short(tag):
    return tag.removeprefix(DCC) if tag.startswith(DCC) else f"si.{tag.removeprefix(SI)}"
