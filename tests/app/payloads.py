"""Texts that would do harm where they were taken for more than text: markup, templates, formulas, paths."""

MARKUP = (
    *("<img src=x onerror=alert(1)>", '"><script>alert(1)</script>', "'><svg/onload=alert(1)>"),
    *("</title><svg onload=alert(1)>", "</style><script>alert(1)</script>"),
    *("</text><script>alert(1)</script>", "</svg><iframe src=//x>", "<!--<script>", "]]><!--", "--><b>"),
    *("<![CDATA[<b>x</b>]]>", "<?xml version='1.0'?>"),
    *("<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>", "&e;", "&lt;b&gt;", "&#60;script&#62;"),
    *("<a href=javascript:alert(1)>x", "<style>*{display:none}</style>"),
    *("<link rel=stylesheet href=//x>", "<base href=//x>", "<meta http-equiv=refresh content=0;url=//x>"),
    *("<foreignObject><b>", "<use href='#day680-t'/>", "<math><mtext></mtext></math>", "<template><b>"),
    *('" onmouseover=alert(1) x="', "' autofocus onfocus=alert(1) '", "javascript:alert(1)"),
    *("url(//x) ; expression(1)", "`${alert(1)}`"),
)
TEMPLATES = (
    *("{{7*7}}", "{% raw %}{{ report }}", "{# x #}", "${7*7}", "#{7*7}", "<%= 7*7 %>", "%s %n %x %(a)s"),
    *("{0.__class__}", "{report}[{report}]", '#eval("1+1")', '#read("/etc/passwd")', '#import "x.typ"'),
    *("#panic()", "*bold* _it_ $x$", "@ref <label> // end", "```raw``` `x`", "= head - item + enum"),
    *("\\u{41} \\n \\\\", "/* x */"),
)
FORMULAS = (
    *("=1+1", "+1+1", "-1+1", "@SUM(A1)", "=cmd|' /C calc'!A0", '=HYPERLINK("http://x","y")'),
    *("=IMPORTXML(1)", 'DDE("cmd")', " =1+1", "a;=1+1", "a,=1+1", '";=1+1', "'=1+1", "\uff1d1+1"),
)
PATHS = (
    *("../../etc/passwd", "..\\..\\windows", "file:///etc/passwd", "/dev/null", "C:\\con"),
    *("a' OR '1'='1", "; DROP TABLE analyses; --", "$(reboot) | x && y"),
)
FAMILIES = {"markup": MARKUP, "templates": TEMPLATES, "formulas": FORMULAS, "paths": PATHS}
PAYLOADS = MARKUP + TEMPLATES + FORMULAS + PATHS
