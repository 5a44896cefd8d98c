// What a reader clicks and slides.

/** Call back with the colours chosen; the buttons tell which are, and their keys are shown. */
export function buttons(figure, choose) {
  const all = [...figure.querySelectorAll('button[data-colours]')];
  const keys = [...figure.querySelectorAll('[data-key]')];
  const press = (button) => {
    for (const each of all) each.setAttribute('aria-pressed', String(each === button));
    for (const key of keys) key.hidden = key.dataset.key !== button.dataset.colours;
    choose(button.dataset.colours);
  };
  for (const button of all) button.addEventListener('click', () => press(button));
  const first = all.find((button) => button.getAttribute('aria-pressed') === 'true') ?? all[0];
  if (first) press(first);
}

/** Call back with the value of a slider, and tell it in words beside it. */
export function slider(figure, name, tell, change) {
  const input = figure.querySelector(`input[name="${name}"]`);
  const output = figure.querySelector(`output[for="${input.id}"]`);
  const moved = () => {
    const value = Number(input.value);
    const told = tell(value);
    output.textContent = told;
    input.setAttribute('aria-valuetext', told);
    change(value);
  };
  input.addEventListener('input', moved);
  moved();
}
