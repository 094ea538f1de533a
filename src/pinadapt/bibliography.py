"""What this library is built on; laws and adaptations name their sources among these."""

from __future__ import annotations

from ._version import __version__
from .reference import Reference

_TAC = "IEEE Transactions on Automatic Control"
_IJRR = "The International Journal of Robotics Research"


def _article(
    key: str, author: str, title: str, journal: str, volume: str, pages: str, year: str
) -> Reference:
    """Return an article; volume with its number as "45(9)"."""
    volume, _, number = volume.rstrip(")").partition("(")
    fields = {"author": author, "title": title, "journal": journal, "volume": volume}
    if number:
        fields["number"] = number
    return Reference(key, {**fields, "pages": pages, "year": year})


WANG_XIE = _article(
    "WangXie2009",
    "Wang, Hanlei and Xie, Yongchun",
    "Adaptive inverse dynamics control of robots with uncertain kinematics and dynamics",
    "Automatica",
    "45(9)",
    "2114--2119",
    "2009",
)
WANG = _article(
    "Wang2017",
    "Wang, Hanlei",
    "Adaptive control of robot manipulators with uncertain kinematics and dynamics",
    _TAC,
    "62(2)",
    "948--954",
    "2017",
)
LUH_WALKER_PAUL = _article(
    "LuhWalkerPaul1980",
    "Luh, J. Y. S. and Walker, M. W. and Paul, R. P. C.",
    "Resolved-acceleration control of mechanical manipulators",
    _TAC,
    "25(3)",
    "468--474",
    "1980",
)
CHEAH_LIU_SLOTINE = _article(
    "CheahLiuSlotine2006",
    "Cheah, C. C. and Liu, C. and Slotine, J. J. E.",
    "Adaptive Jacobian tracking control of robots with uncertainties in kinematic, dynamic and "
    "actuator models",
    _TAC,
    "51(6)",
    "1024--1029",
    "2006",
)
SLOTINE_LI = _article(
    "SlotineLi1987",
    "Slotine, Jean-Jacques E. and Li, Weiping",
    "On the adaptive control of robot manipulators",
    _IJRR,
    "6(3)",
    "49--59",
    "1987",
)
SLOTINE_LI_COMPOSITE = _article(
    "SlotineLi1989",
    "Slotine, Jean-Jacques E. and Li, Weiping",
    "Composite adaptive control of robot manipulators",
    "Automatica",
    "25(4)",
    "509--519",
    "1989",
)
CHEAH_KAWAMURA_ARIMOTO = _article(
    "CheahKawamuraArimoto1999",
    "Cheah, C. C. and Kawamura, S. and Arimoto, S.",
    "Feedback control for robotic manipulator with an uncertain Jacobian matrix",
    "Journal of Robotic Systems",
    "16(2)",
    "119--134",
    "1999",
)
CHEAH_HIRANO_KAWAMURA_ARIMOTO = _article(
    "CheahHiranoKawamuraArimoto2003",
    "Cheah, C. C. and Hirano, M. and Kawamura, S. and Arimoto, S.",
    "Approximate Jacobian control for robots with uncertain kinematics and dynamics",
    "IEEE Transactions on Robotics and Automation",
    "19(4)",
    "692--702",
    "2003",
)
YAZAREL_CHEAH = _article(
    "YazarelCheah2002",
    "Yazarel, H. and Cheah, C. C.",
    "Task-space adaptive control of robotic manipulators with uncertainties in gravity regressor "
    "matrix and kinematics",
    _TAC,
    "47(9)",
    "1580--1585",
    "2002",
)
DIXON = _article(
    "Dixon2007",
    "Dixon, W. E.",
    "Adaptive regulation of amplitude limited robot manipulators with uncertain kinematics and "
    "dynamics",
    _TAC,
    "52(3)",
    "488--493",
    "2007",
)
MIDDLETON_GOODWIN = _article(
    "MiddletonGoodwin1988",
    "Middleton, Richard H. and Goodwin, Graham C.",
    "Adaptive computed torque control for rigid link manipulators",
    "Systems \\& Control Letters",
    "10(1)",
    "9--16",
    "1988",
)
CRAIG_HSU_SASTRY = _article(
    "CraigHsuSastry1987",
    "Craig, John J. and Hsu, Ping and Sastry, S. Shankar",
    "Adaptive control of mechanical manipulators",
    _IJRR,
    "6(2)",
    "16--28",
    "1987",
)
SPONG_ORTEGA = _article(
    "SpongOrtega1990",
    "Spong, Mark W. and Ortega, Romeo",
    "On adaptive inverse dynamics control of rigid robots",
    _TAC,
    "35(1)",
    "92--95",
    "1990",
)
MARKIEWICZ = Reference(
    "Markiewicz1973",
    {
        "author": "Markiewicz, B. R.",
        "title": "Analysis of the computed torque drive method and comparison with conventional "
        "position servo for a computer-controlled manipulator",
        "institution": "Jet Propulsion Laboratory",
        "type": "Technical Memorandum",
        "number": "33-601",
        "year": "1973",
    },
    "techreport",
)
LEE_KWON_PARK = Reference(
    "LeeKwonPark2018",
    {
        "author": "Lee, Taeyoon and Kwon, Jaewoon and Park, Frank C.",
        "title": "A natural adaptive control law for robot manipulators",
        "booktitle": "IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS)",
        "year": "2018",
    },
    "inproceedings",
)
WENSING_SLOTINE = _article(
    "WensingSlotine2020",
    "Wensing, Patrick M. and Slotine, Jean-Jacques",
    "Beyond convexity---Contraction and global convergence of gradient descent",
    "PLoS ONE",
    "15(8)",
    "e0236661",
    "2020",
)
BOFFI_SLOTINE = _article(
    "BoffiSlotine2021",
    "Boffi, Nicholas M. and Slotine, Jean-Jacques E.",
    "Implicit regularization and momentum algorithms in nonlinearly parameterized adaptive control "
    "and prediction",
    "Neural Computation",
    "33(3)",
    "590--673",
    "2021",
)
SALGADO_GOODWIN_MIDDLETON = _article(
    "SalgadoGoodwinMiddleton1988",
    "Salgado, M. E. and Goodwin, G. C. and Middleton, R. H.",
    "Modified least squares algorithm incorporating exponential resetting and forgetting",
    "International Journal of Control",
    "47(2)",
    "477--491",
    "1988",
)
SPONG = _article(
    "Spong1987",
    "Spong, Mark W.",
    "Modeling and control of elastic joint robots",
    "Journal of Dynamic Systems, Measurement, and Control",
    "109(4)",
    "310--319",
    "1987",
)
NARENDRA_ANNASWAMY = _article(
    "NarendraAnnaswamy1987",
    "Narendra, Kumpati S. and Annaswamy, Anuradha M.",
    "A new adaptive law for robust adaptation without persistent excitation",
    _TAC,
    "32(2)",
    "134--145",
    "1987",
)
PETERSON_NARENDRA = _article(
    "PetersonNarendra1982",
    "Peterson, Benjamin B. and Narendra, Kumpati S.",
    "Bounded error adaptive control",
    _TAC,
    "27(6)",
    "1161--1168",
    "1982",
)
KREISSELMEIER = _article(
    "Kreisselmeier1977",
    "Kreisselmeier, Gerhard",
    "Adaptive observers with exponential rate of convergence",
    _TAC,
    "22(1)",
    "2--8",
    "1977",
)
PAN_YU = _article(
    "PanYu2018",
    "Pan, Yongping and Yu, Haoyong",
    "Composite learning robot control with guaranteed parameter convergence",
    "Automatica",
    "89",
    "398--406",
    "2018",
)
FORTESCUE_KERSHENBAUM_YDSTIE = _article(
    "FortescueKershenbaumYdstie1981",
    "Fortescue, T. R. and Kershenbaum, L. S. and Ydstie, B. E.",
    "Implementation of self-tuning regulators with variable forgetting factors",
    "Automatica",
    "17(6)",
    "831--835",
    "1981",
)
IOANNOU_KOKOTOVIC = _article(
    "IoannouKokotovic1984",
    "Ioannou, Petros A. and Kokotovic, Petar V.",
    "Instability analysis and improvement of robustness of adaptive control",
    "Automatica",
    "20(5)",
    "583--594",
    "1984",
)
IOANNOU_SUN = Reference(
    "IoannouSun1996",
    {
        "author": "Ioannou, Petros A. and Sun, Jing",
        "title": "Robust Adaptive Control",
        "publisher": "Prentice Hall",
        "year": "1996",
    },
    "book",
)
PINOCCHIO = Reference(
    "Carpentier2019",
    {
        "author": "Carpentier, Justin and Saurel, Guilhem and Buondonno, Gabriele and Mirabel, "
        "Joseph and Lamiraux, Florent and Stasse, Olivier and Mansard, Nicolas",
        "title": "The Pinocchio C++ library: A fast and flexible implementation of rigid body "
        "dynamics algorithms and their analytical derivatives",
        "booktitle": "IEEE/SICE International Symposium on System Integration (SII)",
        "pages": "614--619",
        "year": "2019",
    },
    "inproceedings",
)
PINADAPT = Reference(
    "pinadapt",
    {
        "author": "{The pinadapt developers}",
        "title": "{pinadapt}: Adaptive control of robots with uncertain kinematics and dynamics, "
        "on {Pinocchio}",
        "version": __version__,
        "year": "2026",
    },
    "software",
)
