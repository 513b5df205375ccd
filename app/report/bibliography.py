"""What the report cites, with the identifiers that lead there; the same in every language.

Each was found under its identifier, or under journal, volume and pages where none is given. Context for a
reader: nothing here is turned into a figure about one person.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Publication:
    """A publication as the text cites it and in full; ``doi`` is empty where none is known."""

    cited: str
    full: str
    doi: str = ""

    def format(self) -> str:
        """Write it as one line of a bibliography."""
        return f"{self.full} doi:{self.doi}" if self.doi else self.full


BIBLIOGRAPHY = (
    Publication(
        "Arvidsson et al. 2021",
        "Arvidsson I, Dahlqvist C, Enquist H, Nordander C. Action levels for the prevention of work-related "
        "musculoskeletal disorders in the neck and upper extremities: a proposal. Ann Work Expo Health "
        "2021;65(7):741–747.",
        "10.1093/annweh/wxab012",
    ),
    Publication(
        "Bioengineering 2025;12:50",
        "Reliability and accuracy of standard reference procedures for measurements of trunk and arm "
        "postures in ergonomics. Bioengineering 2025;12(1):50.",
        "10.3390/bioengineering12010050",
    ),
    Publication(
        "Dalbøge et al. 2022",
        "Dalbøge A, Frost P, Andersen JH, Svendsen SW. Associations between single and combined occupational "
        "mechanical exposures and surgery for subacromial impingement syndrome: a nationwide Danish cohort "
        "study. Scand J Work Environ Health 2022;48(6):490–497.",
        "10.5271/sjweh.4032",
    ),
    Publication(
        "EN 1005-4",
        "EN 1005-4:2005+A1:2008. Safety of machinery – Human physical performance – Part 4: Evaluation of "
        "working postures and movements in relation to machinery.",
    ),
    Publication(
        "Fan et al. 2021",
        "Fan X, Lind CM, Rhén I-M, Forsman M. Effects of sensor types and angular velocity computational "
        "methods in field measurements of occupational upper arm and trunk postures and movements. Sensors "
        "2021;21(16):5527.",
        "10.3390/s21165527",
    ),
    Publication(
        "Hansson et al. 2010",
        "Hansson G-Å, Balogh I, Ohlsson K, et al. Physical workload in various types of work: Part II. Neck, "
        "shoulder and upper arm. Int J Ind Ergon 2010;40(3):267–281.",
    ),
    Publication("ISO 11226", "ISO 11226:2000. Ergonomics – Evaluation of static working postures."),
    Publication(
        "Lewis et al. 2026",
        "Lewis C, Abtahi F, Forsman M, et al. Trunk and upper arm postures and movements among older workers "
        "in physically demanding occupations. Ann Work Expo Health 2026;70(3):wxag027.",
        "10.1093/annweh/wxag027",
    ),
    Publication(
        "Mathiassen and Winkel 1991",
        "Mathiassen SE, Winkel J. Quantifying variation in physical load using exposure-vs-time data. "
        "Ergonomics 1991;34(12):1455–1468.",
        "10.1080/00140139108964889",
    ),
    Publication(
        "Palm et al. 2018",
        "Palm P, Gupta N, Forsman M, Skotte J, Nordquist T, Holtermann A. Exposure to upper arm "
        "elevation during work compared to leisure among 12 different occupations measured with triaxial "
        "accelerometers. Ann Work Expo Health 2018;62(6):689–698.",
        "10.1093/annweh/wxy037",
    ),
    Publication(
        "Schall et al. 2016",
        "Schall MC, Fethke NB, Chen H, Oyama S, Douphrate DI. Accuracy and repeatability of an inertial "
        "measurement unit system for field-based occupational studies. Ergonomics 2016;59(4):591–602.",
        "10.1080/00140139.2015.1079335",
    ),
    Publication(
        "Seidler et al. 2020",
        "Seidler A, Romero Starke K, Freiberg A, Hegewald J, Nienhaus A, Bolm-Audorff U. Dose–response "
        "relationship between physical workload and specific shoulder diseases – a systematic review with "
        "meta-analysis. Int J Environ Res Public Health 2020;17(4):1243.",
        "10.3390/ijerph17041243",
    ),
    Publication(
        "Svendsen et al. 2004",
        "Svendsen SW, Bonde JP, Mathiassen SE, Stengaard-Pedersen K, Frich LH. Work related shoulder "
        "disorders: quantitative exposure-response relations with reference to arm posture. Occup Environ "
        "Med 2004;61(10):844–853.",
        "10.1136/oem.2003.010637",
    ),
    Publication(
        "Wahlström et al. 2010",
        "Wahlström J, Mathiassen SE, Liv P, Hedlund P, Ahlgren C, Forsman M. Upper arm postures and "
        "movements in female hairdressers across four full working days. Ann Occup Hyg 2010;54(5):584–594.",
    ),
    Publication(
        "Weber et al. 2018",
        "Weber B, Douwes M, Forsman M, et al. Assessing arm elevation at work with technical assessment "
        "systems. PEROSH, 2018.",
        "10.23775/20181201",
    ),
    Publication(
        "Wærsted et al. 2020",
        "Wærsted M, Koch M, Veiersted KB. Work above shoulder level and shoulder complaints: a systematic "
        "review. Int Arch Occup Environ Health 2020;93(8):925–954.",
        "10.1007/s00420-020-01551-4",
    ),
)


def format_bibliography() -> tuple[str, ...]:
    """Give every publication in full, in the order of the first author."""
    return tuple(publication.format() for publication in BIBLIOGRAPHY)
