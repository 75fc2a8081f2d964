// SPDX-License-Identifier: MIT
// bench.js - the profile bench of the site. MATERIALS (of make_site.py), makeOptics (make_optics.py), plot (the viewer's) are there.
'use strict';

const CHANNELS = 3;
const find = id => document.getElementById(id);
const option = (value, text) => Object.assign(document.createElement('option'), { value, textContent: text });

// The answer for coefficients: lists of numbers, as the members of struct bench (bench.c) lie in memory.
function run(optics, medium, model, gaussians) {
  const radii = optics._bench_radii(), most = optics._bench_gaussians(), at = optics._malloc(optics._bench_bytes());
  const heap = () => optics.HEAPF64.subarray(at / 8, (at + optics._bench_bytes()) / 8); // memory may grow, and move
  heap().set([...medium.sigma_a, ...medium.sigma_s_reduced, medium.eta]);
  const code = optics._bench_run(at, model, gaussians);
  let from = 2 * CHANNELS + 1;
  const take = count => Array.from(heap().slice(from, from += count));
  const three = count => [take(count), take(count), take(count)];
  const answer = { code, r: take(radii), R: three(radii), fit: three(radii), total: take(CHANNELS), mean_free_path: take(CHANNELS),
    diffuse_mean_free_path: take(CHANNELS), error: take(CHANNELS), variance: three(most), weight: three(most) };
  optics._free(at);
  return answer;
}

const medium = () => ({ sigma_a: [0, 1, 2].map(c => Number(find('a' + c).value)),
  sigma_s_reduced: [0, 1, 2].map(c => Number(find('s' + c).value)), eta: Number(find('eta').value) });

function fill(name) {
  const m = MATERIALS[name];
  for (let c = 0; c < CHANNELS; c++) {
    find('a' + c).value = m.sigma_a[c];
    find('s' + c).value = m.sigma_s_reduced[c];
  }
  find('eta').value = m.eta;
}

function row(title, values, name) {
  const line = document.createElement('tr');
  line.append(Object.assign(document.createElement('th'), { textContent: title }));
  for (const v of values) {
    const textContent = Number.isFinite(v) ? Number(v.toPrecision(5)) : '-';
    const cell = Object.assign(document.createElement('td'), { textContent });
    cell.dataset[name] = String(v); // all its digits, to compare
    line.append(cell);
  }
  return line;
}

function draw(optics) {
  const model = find('model').selectedIndex, count = Number(find('gaussians').value), fault = find('fault');
  const answer = run(optics, medium(), model, count), name = find('material').value;
  fault.hidden = answer.code === 0;
  fault.textContent = answer.code === 0 ? ''
    : 'No medium has these coefficients: both are at least 0, scattering is above 0, and the index is 1 to 4.';
  if (answer.code !== 0) return;
  find('curves').replaceChildren(plot(answer.r, answer.R, { fit: count ? answer.fit : null }) ?? 'There is no light.');
  const rows = [row('total reflectance', answer.total, 'total'), row('mean free path, mm', answer.mean_free_path, 'path'),
    row('diffuse mean free path, mm', answer.diffuse_mean_free_path, 'diffuse')];
  if (count) rows.push(row('error of the fit, %', answer.error.map(e => 100 * e), 'error'));
  for (let i = 0; i < count; i++) {
    rows.push(row(`variance ${i + 1}, mm²`, answer.variance.map(v => v[i]), 'variance'));
    rows.push(row(`weight ${i + 1}`, answer.weight.map(w => w[i]), 'weight'));
  }
  find('numbers').tBodies[0].replaceChildren(...rows);
  find('curves').dataset.r = answer.r.join(' ');
  find('curves').dataset.values = answer.R.map(v => v.join(' ')).join(';');
  find('limits').textContent = 'Of this model: ' + optics.UTF8ToString(optics._bench_model_text(model, 2));
  find('command').textContent = name ? `pellucid profile ${name} --model ${find('model').value} --gaussians ${count}`
    : `pellucid profile material.json --model ${find('model').value} --gaussians ${count}`;
  document.documentElement.dataset.bench = 'ready';
}

makeOptics().then(optics => {
  const asked = new URLSearchParams(location.search);
  for (const [name, m] of Object.entries(MATERIALS)) find('material').append(option(name, m.title));
  find('material').append(option('', 'of your own'));
  for (let i = 0, name; (name = optics._bench_model_text(i, 0)); i++)
    find('model').append(option(optics.UTF8ToString(name), optics.UTF8ToString(optics._bench_model_text(i, 1))));
  for (let k = 0; k <= optics._bench_gaussians(); k++) find('gaussians').append(option(k, k || 'none'));
  find('material').value = asked.get('material') in MATERIALS ? asked.get('material') : 'marble';
  find('model').value = asked.get('model') ?? 'dipole';
  if (find('model').selectedIndex < 0) find('model').selectedIndex = 0;
  find('gaussians').value = Math.min(Math.max(Math.round(Number(asked.get('gaussians') ?? 4)) || 0, 0), optics._bench_gaussians());
  fill(find('material').value);
  find('bench').addEventListener('input', event => {
    if (event.target.type === 'number') find('material').value = '';
    else if (event.target.id === 'material' && event.target.value) fill(event.target.value);
    draw(optics);
  });
  find('bench').addEventListener('submit', event => event.preventDefault());
  draw(optics);
}).catch(error => {
  find('fault').hidden = false;
  find('fault').textContent = `This browser can't run the optics: ${error.message}`;
});
