# ruff: noqa: RUF001  # Greek letters are meant
"""The paper's equations as text, as they hold, and what is printed where the print is wrong.

    equation("(28)").text       # the law
    equation("(38)").printed    # which of its terms is wrong

``_x`` is a subscript, one dot or two above a symbol are derivatives.
"""

from typing import NamedTuple

from eulerparams_control.errors import UnknownNameError


class Equation(NamedTuple):
    """An equation of the paper.

    Attributes:
        number: as the paper has it, such as ``(28)``.
        text: as it holds.
        printed: what the paper prints instead, or what it leaves out; "" if it is right.
    """

    number: str
    text: str
    printed: str = ""


_HOLDS = {
    1: "Ṙ = S(ω) R",
    2: "R(φ) = R_x(α) R_y(β) R_z(γ), and so for all 12 sequences",
    3: "ω = T(φ) φ̇",
    4: "R(θ, r) = cos θ I + (1 - cos θ) r rᵀ + sin θ S(r)",
    5: "η = cos(θ/2), ε = sin(θ/2) r",
    6: "η² + εᵀ ε = 1",
    7: "R(η, ε) = (η² - εᵀ ε) I + 2 ε εᵀ + 2 η S(ε)",
    8: "η̇ = -½ εᵀ ω",
    9: "ε̇ = ½ E(η, ε) ω",
    10: "E(η, ε) = η I - S(ε)",
    11: "R_21 = R_1ᵀ R_2",
    12: "η_21 = η_1 η_2 + ε_1ᵀ ε_2",
    13: "ε_21 = η_1 ε_2 - η_2 ε_1 - S(ε_1) ε_2",
    14: "Ṙ_21 = S(Δω_21) R_21",
    15: "Δω_21 = R_1ᵀ (ω_2 - ω_1)",
    16: "η̇_21 = -½ ε_21ᵀ Δω_21",
    17: "ε̇_21 = ½ E(η_21, ε_21) Δω_21",
    20: "[ṗ_e; ω_e] = J(q) q̇",
    22: "Δφ_de = φ_d - φ_e, wrapped to (-π, π]",
    23: "q̇ = J_A⁻¹ [ṗ_d + k_Pp Δp_de; φ̇_d + k_Po Δφ_de]",
    24: "J_A = diag(I, T⁻¹(φ_e)) J, J_A⁻¹ = J⁻¹ diag(I, T(φ_e))",
    27: "ε_de = η_e ε_d - η_d ε_e - S(ε_d) ε_e",
    28: "q̇ = J⁻¹ [ṗ_d + k_Pp Δp_de; ω_d + k_Po ε_de]",
    29: "Δω_de + k_Po ε_de = 0, so that η = tanh(k_Po t/2 + c)",
    30: "V_1 = (η_de - 1)² + ε_deᵀ ε_de = 2 (1 - η_de)",
    31: "V̇_1 = -k_Po ε_deᵀ ε_de",
    33: "τ = B J⁻¹ (a - J̇ q̇) + C q̇ + d + g",
    36: "a_p = p̈_d + k_Vp Δṗ_de + k_Pp Δp_de",
    38: "a_o = T(φ_e) (φ̈_d + k_Vo Δφ̇_de + k_Po Δφ_de) + Ṫ(φ_e, φ̇_e) φ̇_e",
    39: "Δφ̈_de + k_Vo Δφ̇_de + k_Po Δφ_de = 0",
    40: "a_o = ω̇_d + k_Vo Δω_de + k_Po ε_de",
    41: "Δω̇_de + k_Vo Δω_de + k_Po ε_de = 0",
    42: "V_2 = k_Po V_1 + ½ Δω_deᵀ Δω_de",
    43: "V̇_2 = -k_Vo Δω_deᵀ Δω_de",
    44: "Q1 = {η_de = -1, ε_de = 0, Δω_de = 0}",
    45: "Q2 = {η_de = 1, ε_de = 0, Δω_de = 0}",
    46: "V_2 = 4 k_Po at Q1",
    47: "V_2 = 4 k_Po - 2 σ k_Po for η_de = -1 + σ",
    48: "τ = τ_m + Jᵀ h",
    49: "a_p = p̈_c + k_Vp Δṗ_ce + k_Pp Δp_ce",
    50: "a_o = T(φ_e) (φ̈_c + k_Vo Δφ̇_ce + k_Po Δφ_ce) + Ṫ(φ_e, φ̇_e) φ̇_e",
    51: "a_o = ω̇_c + k_Vo Δω_ce + k_Po ε_ce",
    52: "M_p Δp̈_cd + D_p Δṗ_cd + K_p Δp_cd = f",
    53: "K_p = U_p Γ_p U_pᵀ",
    54: "f_E = γ_pi λ u_pi",
    55: "M_o Δφ̈_cd + D_o Δφ̇_cd + K_o Δφ_cd = Tᵀ(φ_c) μ",
    56: "μ_E = T⁻ᵀ(φ_c) K_o Δφ_cd",
    57: "d(Δφ_cd) = T⁻¹(φ_d) Δω_cd dt",
    58: "μ_E = T⁻ᵀ(φ_d) K_o T⁻¹(φ_d) Δω_cd dt",
    59: "M_o Δω̇_cd + D_o Δω_cd + K_o′ ε_cd = μ, all in the desired frame",
    60: "K_o′ = 2 Eᵀ(η_cd, ε_cd) K_o",
    61: "dε_cd = ½ Δω_cd dt",
    62: "μ_E = Eᵀ(1 + dη_cd, dε_cd) K_o Δω_cd dt, which is K_o Δω_cd dt",
    63: "K_o = U_o Γ_o U_oᵀ",
    64: "η_cd = cos(θ/2), ε_cd = sin(θ/2) u_oi",
    65: "μ_E = γ_oi sin θ u_oi",
    66: "μ_E = 2 (η_cd K_o ε_cd + S(ε_cd) K_o ε_cd) = 0",
    67: "Q3 = {η_cd = 0, K_o ε_cd = γ_o ε_cd, |ε_cd| = 1, Δω_cd = 0}",
    68: "V_3 = ½ Δω_cdᵀ M_o Δω_cd + 2 ε_cdᵀ K_o ε_cd",
    69: "V̇_3 = -Δω_cdᵀ D_o Δω_cd",
    70: "V_3 = 2 γ_oi at Q3",
    71: "V_3 = 2 γ_o (1 - σ²) for η_cd = σ",
}

_PRINTED = {
    4: "-sin θ S(r), which is R transposed",
    7: "-2 η S(ε), which is R transposed",
    22: "without wrapping, which a difference of angles needs",
    24: "J_A itself, which is unbounded at the pole; the product on the right exists there",
    31: "that it is negative definite; it vanishes at η_de = -1, too",
    38: "φ̇_d for φ̈_d as the first term",
    49: "ṗ_c for p̈_c as the first term",
    50: "T(φ_e) φ̇_e for Ṫ(φ_e, φ̇_e) φ̇_e as the last term",
    52: "f as in (32), of the end effector on the environment; here it acts on the end effector",
    55: "μ as in (32), of the end effector on the environment; here it acts on the end effector",
    59: "nothing of the turning frame: ω̇_c = ω̇_d + R_d ẋ + ω_d × ω_c with x the components of "
    "Δω_cd, and μ acts on the end effector",
    62: "Eᵀ(dη_cd, dε_cd), whose scalar part is 0 instead of 1",
}


def equation(number: str) -> Equation:
    """Return an equation by its number, such as ``(28)``; a reference is returned as it is.

    Raises:
        UnknownNameError: if the paper has no such equation, or it is not written out here.
    """
    inner = number.strip("()")
    if not inner.isdigit():
        return Equation(number, "")
    if int(inner) not in _HOLDS:
        raise UnknownNameError("equation", number, (f"({n})" for n in _HOLDS))
    return Equation(number, _HOLDS[int(inner)], _PRINTED.get(int(inner), ""))
