"""A building model in IFC4, written here line by line: two walls, one of them coloured, and a room that nobody sees."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.processes import reading_apart

STEP = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('ViewDefinition [ReferenceView]'),'2;1');
FILE_NAME('shed.ifc','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('IFC4'));
ENDSEC;
DATA;
#1=IFCCARTESIANPOINT((0.,0.,0.));
#2=IFCAXIS2PLACEMENT3D(#1,$,$);
#3=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#2,$);
#4=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);
#5=IFCUNITASSIGNMENT((#4));
#6=IFCPROJECT('0000000000000000000001',$,'Shed',$,$,$,$,(#3),#5);
#7=IFCLOCALPLACEMENT($,#2);
#8=IFCSITE('0000000000000000000002',$,'Site',$,$,#7,$,$,.ELEMENT.,$,$,$,$,$);
#9=IFCRELAGGREGATES('0000000000000000000003',$,$,$,#6,(#8));
#10=IFCCARTESIANPOINT((0.,0.));
#11=IFCAXIS2PLACEMENT2D(#10,$);
#12=IFCRECTANGLEPROFILEDEF(.AREA.,$,#11,6000.,300.);
#13=IFCDIRECTION((0.,0.,1.));
#14=IFCEXTRUDEDAREASOLID(#12,#2,#13,3000.);
#15=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#14));
#16=IFCPRODUCTDEFINITIONSHAPE($,$,(#15));
#17=IFCCARTESIANPOINT((10000.,20000.,500.));
#18=IFCAXIS2PLACEMENT3D(#17,$,$);
#19=IFCLOCALPLACEMENT(#7,#18);
#20=IFCWALL('0000000000000000000004',$,'plain',$,$,#19,#16,$,$);
#21=IFCEXTRUDEDAREASOLID(#12,#2,#13,2000.);
#22=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#21));
#23=IFCPRODUCTDEFINITIONSHAPE($,$,(#22));
#24=IFCCARTESIANPOINT((10000.,24000.,500.));
#25=IFCAXIS2PLACEMENT3D(#24,$,$);
#26=IFCLOCALPLACEMENT(#7,#25);
#27=IFCWALL('0000000000000000000005',$,'red',$,$,#26,#23,$,$);
#28=IFCCOLOURRGB($,0.9,0.1,0.05);
#29=IFCSURFACESTYLERENDERING(#28,0.,$,$,$,$,$,$,.FLAT.);
#30=IFCSURFACESTYLE('red',.BOTH.,(#29));
#31=IFCSTYLEDITEM(#21,(#30),$);
#32=IFCEXTRUDEDAREASOLID(#12,#2,#13,9000.);
#33=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#32));
#34=IFCPRODUCTDEFINITIONSHAPE($,$,(#33));
#35=IFCSPACE('0000000000000000000006',$,'room',$,$,#26,#34,$,.ELEMENT.,.SPACE.,$);
#36=IFCRELCONTAINEDINSPATIALSTRUCTURE('0000000000000000000007',$,$,$,(#20,#27),#8);
#37=IFCRELAGGREGATES('0000000000000000000008',$,$,$,#8,(#35));
ENDSEC;
END-ISO-10303-21;
"""


needs_ifc = pytest.mark.skipif(importlib.util.find_spec("ifcopenshell") is None, reason="absent: IfcOpenShell")


def build(folder: Path, text: str):
    path = folder / "shed.ifc"
    path.write_text(text)
    return MeshFile(path=str(path)).build(np.random.default_rng(0))


@pytest.mark.skipif(importlib.util.find_spec("ifcopenshell") is not None, reason="IfcOpenShell is installed")
def test_the_extra_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"shed.ifc: reading IFC needs IfcOpenShell: pip install 'uavbench\[ifc\]'"):
        build(tmp_path, STEP)


@needs_ifc
def test_an_ifc_model_is_read_with_its_units_places_and_colours(tmp_path: Path) -> None:
    thing = build(tmp_path, STEP)
    assert thing.structure.bounds == pytest.approx(np.array([[-3, -2.15, 0], [3, 2.15, 3]]), abs=1e-6)
    assert len(thing.structure.edges) == 2 * 12
    plain, red = sorted(thing.parts, key=lambda part: float(part.vertices[:, 1].mean()))
    assert (plain.name, red.name) == ("plain", "red")
    assert red.tint is not None
    assert red.tint[0, 0] > 5 * red.tint[0, 1]


def test_a_unit_beside_that_of_the_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "shed.ifc"
    path.write_text(STEP)
    with pytest.raises(
        UserError, match=r'shed\.ifc: IFC names its own unit, and is read in metres; delete unit = "mm"'
    ):
        MeshFile(path=str(path), unit="mm").build(np.random.default_rng(0))


@needs_ifc
def test_the_library_is_never_in_our_process(tmp_path: Path) -> None:
    build(tmp_path, STEP)
    assert "ifcopenshell" not in sys.modules


RED = "#21=IFCEXTRUDEDAREASOLID(#12,#2,#13,2000.);"
"""The solid of the red wall."""
HALF = (
    "#22=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#21));",
    "#22=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#21,#41));#41=IFCEXTRUDEDAREASOLID(#12,#2,#13,0.);",
)
"""The representation of the red wall, and one with another solid that is none."""


@needs_ifc
@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (RED, RED.replace("2000.", "0."), r"the geometry of 1 of 2 elements cannot be made: IfcWall 'red'; repair"),
        (RED, "#21=IFCSPHERE(#2,-5.);", r"the geometry of 1 of 2 elements cannot be made: IfcWall 'red'; repair"),
        (
            "6000.,300.",
            "6000.,0.",
            r"the geometry of 2 of 2 elements cannot be made: IfcWall 'plain', IfcWall 'red'; repair",
        ),
        (*HALF, r"a part of its geometry cannot be made: Non-positive extrusion height encountered for #41="),
        ("#26,#23,", "#26,#99,", r"not a readable IFC file: Instance reference #99 used by instance #27"),
        (RED, "", r"not a readable IFC file: Instance reference #21 used by instance #"),
        ("END-ISO-10303-21;\n", "", r"not a readable IFC file: it is truncated"),
        ("'IFC4'", "'IFC9'", r"not a readable IFC file: Unsupported schema: IFC9"),
    ],
)
def test_no_element_is_lost_silently(tmp_path: Path, before: str, after: str, told: str) -> None:
    assert before in STEP
    with pytest.raises(UserError, match=rf"shed\.ifc: {told}"):
        build(tmp_path, STEP.replace(before, after))


@needs_ifc
def test_elements_without_a_body_are_not_missed(tmp_path: Path) -> None:
    axis = """#41=IFCPOLYLINE((#10,#42));
#42=IFCCARTESIANPOINT((6000.,0.));
#43=IFCSHAPEREPRESENTATION(#3,'Axis','Curve2D',(#41));
#44=IFCPRODUCTDEFINITIONSHAPE($,$,(#43));
#45=IFCWALL('0000000000000000000009',$,'axis',$,$,#19,#44,$,$);
"""
    assert len(build(tmp_path, STEP.replace("ENDSEC;\nEND", f"{axis}ENDSEC;\nEND")).parts) == 2


@needs_ifc
def test_a_model_on_which_the_library_hangs_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading_apart, "MOST_CPU_S", 10)
    with pytest.raises(UserError, match=r"shed\.ifc: (reading it takes more than 10 s|not a readable IFC file)"):
        build(tmp_path, STEP.replace(RED, RED.replace("2000.", "1.E400")))


def test_a_broken_ifc_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"shed.ifc: (not a readable IFC file|reading IFC needs)"):
        build(tmp_path, "ISO-10303-21;\nHEADER;")


CLEARANCE = (
    "(#21));",
    """(#21));
#41=IFCRECTANGLEPROFILEDEF(.AREA.,$,#11,8000.,4000.);
#42=IFCEXTRUDEDAREASOLID(#41,#2,#13,5000.);
#43=IFCSHAPEREPRESENTATION(#3,'Clearance','SweptSolid',(#42));""",
)
"""The representation of the red wall, and beside it the room that is to be kept free about it."""


@needs_ifc
@pytest.mark.parametrize("body", ["'Body'", "$"])
def test_only_the_body_of_an_element_is_drawn(tmp_path: Path, body: str) -> None:
    text = STEP.replace("'Body'", body).replace(*CLEARANCE).replace("(#22))", "(#43,#22))")
    thing = build(tmp_path, text)
    assert thing.structure.bounds == pytest.approx(np.array([[-3, -2.15, 0], [3, 2.15, 3]]), abs=1e-6)
    with pytest.raises(UserError, match=r"the geometry of 1 of 2 elements cannot be made: IfcWall 'red'"):
        build(tmp_path, text.replace(RED, RED.replace("2000.", "0.")))


def mirrored(element: str) -> str:
    """The model with one of its walls as a mirrored copy of a shape, as programs place instances of windows."""
    return (
        STEP.replace(f"(#{element}));\n", "(#46));\n", 1)
        .replace("SweptSolid',(#46)", "MappedRepresentation',(#46)")
        .replace(
            "ENDSEC;\nEND",
            f"""#41=IFCREPRESENTATIONMAP(#2,#47);
#42=IFCDIRECTION((-1.,0.,0.));
#43=IFCDIRECTION((0.,1.,0.));
#44=IFCCARTESIANTRANSFORMATIONOPERATOR3D(#42,#43,#1,1.,#13);
#46=IFCMAPPEDITEM(#41,#44);
#47=IFCSHAPEREPRESENTATION(#3,'Body','SweptSolid',(#{element}));
ENDSEC;\nEND""",
        )
    )


@needs_ifc
@pytest.mark.parametrize("element", ["14", "21"], ids=["larger", "smaller"])
def test_a_mirrored_element_faces_outwards(tmp_path: Path, element: str) -> None:
    for part in build(tmp_path, mirrored(element)).parts:
        middle = part.vertices.mean(axis=0)
        a, b, c = (part.vertices[part.triangles[:, k]] - middle for k in range(3))
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0, part.name


@needs_ifc
@pytest.mark.parametrize(
    ("schema", "other"),
    [
        ("IFC4", "IFCSPATIALZONE(@,$,.FIRESAFETY.)"),
        ("IFC4", "IFCEXTERNALSPATIALELEMENT(@,$,$)"),
        ("IFC4", "IFCVOIDINGFEATURE(@,$,.CUTOUT.)"),
        ("IFC4", "IFCSTRUCTURALSURFACEMEMBER(@,.SHELL.,200.)"),
        ("IFC2X3", "IFCSTRUCTURALSURFACEMEMBER(@,.SHELL.,200.)"),
        ("IFC2X3", "IFCOPENINGELEMENT(@,$)"),
    ],
)
def test_zones_cuts_and_structural_analysis_are_not_drawn(tmp_path: Path, schema: str, other: str) -> None:
    zone = f"#41={other}".replace("@", "'0000000000000000000009',$,'other',$,$,#7,#34")
    text = STEP.replace("ENDSEC;\nEND", f"{zone};\nENDSEC;\nEND").replace("IFC4", schema)
    if schema == "IFC2X3":  # whose walls have no kind
        text = text.replace("#16,$,$)", "#16,$)").replace("#23,$,$)", "#23,$)").replace(".SPACE.,$)", ".INTERNAL.,$)")
    assert {part.name for part in build(tmp_path, text).parts} == {"plain", "red"}
