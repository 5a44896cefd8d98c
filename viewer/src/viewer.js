// The 3D view of a report: it reads the page's own data, and asks nothing of any network.
import { bytes, signed, words } from './arrays.js';
import { buttons, slider } from './controls.js';
import { Stage } from './stage.js';
import { Surface } from './surface.js';

const figure = document.getElementById('view');
const source = document.getElementById('view-data');

function read(text) {
  const told = JSON.parse(text);
  return {
    ...told,
    positions: words(told.positions),
    faces: words(told.faces),
    parts: bytes(told.parts),
    heat: told.heat && { ...told.heat, values: bytes(told.heat.values) },
    moves: told.moves && { ...told.moves, values: signed(told.moves.values) },
  };
}

/** Let the still stand for the view, and say so. */
function fallBack() {
  figure.classList.remove('live');
  figure.classList.add('still-only');
}

function start() {
  const view = read(source.textContent);
  const canvas = figure.querySelector('canvas');
  const stage = new Stage(canvas, view);
  const before = view.moves ? new Surface(view) : null;
  const shown = new Surface(view);
  const state = { frame: 0, colours: 'plain', wipe: 0.5, magnify: 1 };

  function draw() {
    const drawn = stage.render(before, shown, state.wipe);
    figure.dataset.drawn = String(drawn);
    figure.dataset.frame = String(state.frame);
    figure.dataset.colours = state.colours;
  }
  function pose() {
    before?.pose(state.frame, 0, 'plain');
    shown.pose(state.frame, view.moves ? state.magnify : 0, state.colours);
    draw();
  }

  // The still stands for the view until this succeeds.
  figure.classList.add('live');
  for (const other of [before, shown]) if (other) stage.add(other);
  stage.onchange(draw);
  buttons(figure, (colours) => {
    state.colours = colours;
    pose();
  });
  const tell = (index) => `${index + 1} of ${view.times.length}, ${view.times[index]}`;
  slider(figure, 'frame', tell, (value) => {
    state.frame = value;
    pose();
  });
  if (view.moves) {
    slider(figure, 'wipe', (value) => `${value} %`, (value) => {
      state.wipe = value / 100;
      draw();
    });
    slider(figure, 'magnify', (value) => `${value} times`, (value) => {
      state.magnify = value;
      pose();
    });
  }
  canvas.addEventListener('webglcontextlost', fallBack);
  pose();
}

// What is folded on the screen is unfolded on paper.
addEventListener('beforeprint', () => {
  for (const each of document.querySelectorAll('details')) each.open = true;
});

if (figure && source) {
  try {
    start();
  } catch (error) {
    fallBack();
    console.info(`no 3D view: ${error.message}`);
  }
}
