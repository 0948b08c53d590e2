"""A building model in IFC4, written here line by line: two walls, one of them coloured, and a room that nobody sees."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.trajectories.errors import UserError

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


def test_an_ifc_model_is_read_with_its_units_places_and_colours_or_the_extra_is_named(tmp_path: Path) -> None:
    path = tmp_path / "shed.ifc"
    path.write_text(STEP)
    model = MeshFile(path=str(path))
    if importlib.util.find_spec("ifcopenshell") is None:
        with pytest.raises(UserError, match=r"shed.ifc: reading IFC needs IfcOpenShell: pip install 'uavbench\[ifc\]'"):
            model.build(np.random.default_rng(0))
        return
    thing = model.build(np.random.default_rng(0))
    assert thing.structure.bounds == pytest.approx(np.array([[-3, -2.15, 0], [3, 2.15, 3]]), abs=1e-6)
    assert len(thing.structure.edges) == 2 * 12
    plain, red = sorted(thing.parts, key=lambda part: float(part.vertices[:, 1].mean()))
    assert (plain.name, red.name) == ("plain", "red")
    assert red.tint is not None
    assert red.tint[0, 0] > 5 * red.tint[0, 1]


def test_a_broken_ifc_file_is_told(tmp_path: Path) -> None:
    (tmp_path / "broken.ifc").write_text("ISO-10303-21;\nHEADER;")
    with pytest.raises(UserError, match=r"broken.ifc: (not a readable IFC file|reading IFC needs|holds nothing)"):
        MeshFile(path=str(tmp_path / "broken.ifc")).build(np.random.default_rng(0))
