// Numbers of three digits; a button shows all of them.

const exact = $$("[data-exact]");

function swapDigits() {
  for (const cell of exact) {
    const text = cell.textContent;
    cell.textContent = cell.dataset.exact;
    cell.dataset.exact = text;
  }
  for (const button of $$(".digits"))
    button.setAttribute("aria-pressed", String(button.getAttribute("aria-pressed") !== "true"));
}

for (const button of $$(".digits")) button.addEventListener("click", swapDigits);
