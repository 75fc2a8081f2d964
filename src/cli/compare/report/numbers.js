// SPDX-License-Identifier: MIT
// The table of metrics, their explanations, and the times.

// --- Numbers --------------------------------------------------------------------------------------------------------------------

const worst = (list) => list.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a), 0);
const rms = (m) => (m && finite(m.rel_mse) ? Math.sqrt(m.rel_mse) : null);
const rmsNoise = (m) => (finite(rms(m)) && rms(m) > 0 && finite(m.rel_mse_error) ? (0.5 * m.rel_mse_error) / rms(m) : null);
const unresolved = (m) => (m && m.not_resolved && 'rel_mse' in m.not_resolved ? m.not_resolved.reason : null);
const metricsOf = (p, key = 'metrics') => p[key] && p[key][views[state.view].id];
const COLUMNS = [
  { id: 'name', head: 'Method', value: (p) => p.name },
  {
    id: 'error',
    head: 'Error',
    value: (p) => rms(metricsOf(p)),
    show: percent,
    within: (p) => rmsNoise(metricsOf(p)),
    hidden: (p) => unresolved(metricsOf(p)),
    meter: true,
    term: 'Error',
    text:
      'Root mean square of the relative error over pixels and channels: the typical error of a pixel. ' +
      'The noise of the reference is subtracted if it is known, and ± is the remaining standard error. 0 is best.',
  },
  {
    id: 'total',
    head: 'With the model',
    only: () => truth,
    value: (p) => rms(metricsOf(p, 'total')),
    show: percent,
    within: (p) => rmsNoise(metricsOf(p, 'total')),
    hidden: (p) => unresolved(metricsOf(p, 'total')),
    meter: true,
    term: 'With the model',
    text: 'The same against the second reference, which does not share the approximations of the first: the total error.',
  },
  {
    id: 'bias',
    head: 'Bias R G B',
    value: (p) => Math.abs(worst(metricsOf(p).rel_bias)),
    cell: (p) =>
      metricsOf(p).rel_bias.map((b, c) => {
        const within = metricsOf(p).rel_bias_error[c];
        return make('span', { class: 'part', text: percent(b, true) + (finite(within) ? ` ± ${percent(within)}\u2003` : '') });
      }),
    term: 'Bias',
    text:
      'How much too bright (+) or too dark (−) the image is on average, for red, green and blue. 0 is best; ' +
      'sorted by the largest of the three.',
  },
  {
    id: 'mae',
    head: 'MAE',
    value: (p) => metricsOf(p).mae,
    show: number,
    term: 'MAE',
    text: 'The mean absolute difference, in the unit of the image. Bright pixels dominate. 0 is best.',
  },
  {
    id: 'ssim',
    head: 'SSIM',
    value: (p) => metricsOf(p).ssim,
    show: (v) => (finite(v) ? v.toFixed(4) : '–'),
    high: true,
    term: 'SSIM',
    text: 'Structural similarity (Wang et al. 2004) of the displayed images: whether edges and shading agree. 1 is best.',
  },
  {
    id: 'flip',
    head: 'FLIP',
    value: (p) => metricsOf(p).flip,
    show: number,
    meter: true,
    term: 'FLIP',
    text:
      'The difference perceived when two images alternate on a screen (Andersson et al. 2020), mean over pixels. 0 is best, ' +
      '1 is the largest difference.',
  },
  {
    id: 'flip_hdr',
    head: 'HDR-FLIP',
    only: () => !data.display,
    value: (p) => metricsOf(p).flip_hdr,
    show: number,
    meter: true,
    term: 'HDR-FLIP',
    text:
      'The largest FLIP over all exposures suitable for the reference (Andersson et al. 2021): errors in ' +
      'highlights and shadows count, too. 0 is best.',
  },
  {
    id: 'seconds',
    head: 'Time',
    only: () => data.kind === 'scene',
    value: (p) => p.seconds,
    show: seconds,
    term: 'Time',
    text: 'From the scene in memory to the finished image, with all threads. Includes preparation that is done once per scene.',
  },
  {
    id: 'cost',
    head: 'Cost',
    only: () => data.kind === 'scene',
    value: (p) => p.cpu_seconds,
    show: seconds,
    term: 'Cost',
    text: 'Processor time of one image, summed over all threads: independent of the number of threads.',
  },
].filter((c) => !c.only || c.only());
const order = { column: COLUMNS[1], down: false };

function table() {
  const rows = methods.slice(),
    { column, down } = order;
  const compare = (a, b) => {
    const x = column.value(a),
      y = column.value(b);
    return typeof x === 'string' ? x.localeCompare(y) : (finite(x) ? x : Infinity) - (finite(y) ? y : Infinity);
  };
  rows.sort((a, b) => (down ? compare(b, a) : compare(a, b)));
  by('heads').replaceChildren(
    ...COLUMNS.map((c) =>
      make(
        'th',
        {
          scope: 'col',
          class: c.id === 'name' ? '' : 'number',
          'aria-sort': c === column ? (down ? 'descending' : 'ascending') : null,
        },
        make('button', { type: 'button', text: c.head, 'data-column': c.id, onclick: () => sortBy(c) }),
      ),
    ),
  );
  const range = (c) => rows.map(c.value).filter(finite);
  by('rows').replaceChildren(
    ...rows.map((p) =>
      make(
        'tr',
        {},
        ...COLUMNS.map((c) => {
          if (c.id === 'name') return make('th', { scope: 'row', text: p.name, title: p.name });
          const v = c.value(p),
            all = range(c),
            best = all.length > 1 && v === (c.high ? Math.max(...all) : Math.min(...all));
          const cell = make(
            'td',
            { class: `number${best && (c.meter || c.high) ? ' best' : ''}` },
            ...(c.cell ? c.cell(p) : [c.hidden && c.hidden(p) ? 'not resolved' : c.show(v)]),
          );
          if (c.within && finite(c.within(p))) cell.append(` ± ${percent(c.within(p))}`);
          if (c.hidden && c.hidden(p)) cell.title = c.hidden(p);
          if (c.meter && finite(v) && all.length > 1) {
            const bar = make('span');
            bar.style.width = `${(100 * v) / (Math.max(...all) || 1)}%`;
            cell.append(make('span', { class: 'meter', 'aria-hidden': 'true' }, bar));
          }
          return cell;
        }),
      ),
    ),
  );
  by('numbers-text').textContent =
    `${views[state.view].title}: ${count(views[state.view].pixels)} pixels, against ${reference.name}. ` +
    (views.length > 1 ? 'Choose the light above the images.' : '');
}

function sortBy(column) {
  order.down = order.column === column ? !order.down : Boolean(column.high);
  order.column = column;
  table();
  by('heads').querySelector(`[data-column="${column.id}"]`).focus();
  by('sorted').textContent = `Sorted by ${column.head}, ${order.down ? 'largest' : 'smallest'} first`;
}

// If noise hides the error of a method, the table is ranked by FLIP.
const hidden = () => methods.some((p) => unresolved(metricsOf(p)));
const rank = (m) => (hidden() ? m.flip : rms(m)) ?? Infinity;
const nearest = () => methods.reduce((a, b) => (rank(metricsOf(b)) < rank(metricsOf(a)) ? b : a));

function summary() {
  const best = nearest(),
    m = metricsOf(best);
  const bias = worst(m.rel_bias),
    what = views[state.view].title.toLowerCase();
  by('summary').replaceChildren(
    ...[
      methods.length > 1 ? `Of ${methods.length} methods, ` : '',
      make('strong', { text: best.name }),
      methods.length > 1 ? ` is closest to ${reference.name}` : ` against ${reference.name}`,
      `, ${what}: the relative error is `,
      make('strong', { text: unresolved(m) ? 'less than the noise' : percent(rms(m)) }),
      `, the bias ${percent(bias, true)} in the worst channel, and FLIP `,
      make('strong', { text: number(m.flip) }),
      '.',
      hidden() ? ` The noise of ${reference.name} hides errors: methods are ranked by FLIP, which includes it. Use more samples.` : '',
      finite(best.seconds) ? ` It took ${seconds(best.seconds)}; ${reference.name} took ${seconds(reference.seconds)}.` : '',
    ],
  );
}

// Errors of the model, separate from those of the methods.
function model() {
  if (!truth || !reference.model) return;
  const id = views[0].id,
    best = nearest(),
    box = (text, v, about) => make('div', {}, make('span', { text }), make('b', { text: percent(v) }), make('span', { text: about }));
  by('model').append(
    make('h3', { text: 'Error of the method, error of the model' }),
    make('p', {
      class: 'prose',
      text:
        `The first number is the error of the approximations of ${best.name}. The second is the error of ${reference.name} against ` +
        `${truth.name}: ` +
        'the error of the model that both use and the second reference does not. The third is the total error.',
    }),
    make(
      'div',
      { class: 'split' },
      box(`${best.name} against ${reference.name}`, rms(best.metrics[id]), 'the method'),
      box(`${reference.name} against ${truth.name}`, rms(reference.model[id]), 'the model'),
      box(`${best.name} against ${truth.name}`, rms(best.total[id]), 'both'),
    ),
  );
}

function numbers() {
  table();
  by('terms').replaceChildren(
    ...COLUMNS.filter((c) => c.term).map((c) => make('div', {}, make('dt', { text: c.term }), make('dd', { text: c.text }))),
  );
  const notes = [],
    noise = data.kind === 'scene' ? reference.rel_noise : data.rel_noise;
  notes.push(
    finite(noise)
      ? `Noise of ${reference.name}: ${percent(noise)}, subtracted from the error; the other metrics include it.`
      : `${reference.name} has no noise estimate: nothing is subtracted.`,
  );
  for (const p of methods) {
    const m = metricsOf(p),
      total = metricsOf(p, 'total');
    if (unresolved(m)) notes.push(`Error of ${p.name}: not resolved, ${unresolved(m)}.`);
    if (truth && unresolved(total)) notes.push(`Error of ${p.name} with the model: not resolved, ${unresolved(total)}.`);
    if (m.agreement) {
      const { agrees, p: chance } = m.agreement;
      notes.push(
        `${p.name} ${agrees ? 'agrees with' : 'differs from'} ${reference.name} ${agrees ? 'within' : 'by more than'} noise ` +
          `(p ${chance < 1e-4 ? '< 0.0001' : `= ${chance.toFixed(4)}`}).`,
      );
    }
  }
  if (truth && finite(truth.rel_noise)) notes.push(`Noise of ${truth.name}: ${percent(truth.rel_noise)}, subtracted as well.`);
  for (const p of methods)
    if (p.mixes)
      notes.push(
        `${p.name} gives finished images, in which subsurface light and reflections can’t be separated: under “${views[0].title}” ` +
          'all light of its pixels is compared with all light of the reference’s.',
      );
  by('notes').textContent = notes.join(' ');
  model();
}

// --- Time -----------------------------------------------------------------------------------------------------------------------

const PALETTE = [
  '#b4572a',
  '#3f7f93',
  '#8d6a9f',
  '#7c8a3a',
  '#c0902f',
  '#5b6aa8',
  '#a34a5e',
  '#4f9077',
  '#8a6a4a',
  '#c77d8d',
  '#4a7ab0',
  '#9a9a3a',
  '#6f6480',
  '#737373',
];

function time() {
  const timed = pictures.filter((p) => p.stages && p.stages.length);
  by('time').hidden = by('nav-time').hidden = !timed.length;
  if (!timed.length) return;
  const names = [...new Set(timed.flatMap((p) => p.stages.map((s) => s.name)))],
    total = (p) => p.stages.reduce((t, s) => t + s.ms, 0);
  const most = Math.max(...timed.map(total)),
    color = (name) => PALETTE[names.indexOf(name) % PALETTE.length];
  by('time-text').textContent =
    `Time of the stages of one image, on ${data.device} with ${data.threads} threads. The scene took ` +
    `${seconds(data.load_seconds)} to load. Samples that depend on the scene only are made in the stage “prepare”.`;
  by('bars').replaceChildren(
    ...timed.map((p) => {
      const stages = p.stages.slice().sort((a, b) => b.ms - a.ms),
        sum = total(p),
        stack = make('div', {
          class: 'stack',
          role: 'img',
          'aria-label': `${p.name}: ${stages.map((s) => `${s.name} ${seconds(s.ms / 1000)}`).join(', ')}`,
        });
      for (const s of stages) {
        const part = make('div', { class: 'segment', title: `${s.name}: ${seconds(s.ms / 1000)}` });
        part.style.width = `${(100 * s.ms) / (by('same').checked ? most : sum)}%`;
        part.style.background = color(s.name);
        stack.append(part);
      }
      return make(
        'div',
        { class: 'time' },
        make('div', { class: 'who', text: p.name, title: p.name }),
        stack,
        make('div', { class: 'sum' }, seconds(p.seconds), make('small', { text: `${seconds(p.cpu_seconds)} of processor` })),
        make(
          'ul',
          { class: 'legend' },
          ...stages
            .filter((s) => s.ms >= 0.01 * sum)
            .map((s) => {
              const key = make('i', { 'aria-hidden': 'true' });
              key.style.background = color(s.name);
              return make('li', {}, key, `${s.name} ${percent(s.ms / sum)}`);
            }),
        ),
      );
    }),
  );
  by('stages').replaceChildren(
    ...timed.flatMap((p) =>
      p.stages.map((s) =>
        make(
          'tr',
          {},
          make('th', { scope: 'row', text: p.name }),
          make('td', { text: s.name }),
          make('td', { class: 'number', text: number(s.ms, 4) }),
          make('td', { class: 'number', text: s.pixels ? count(s.pixels) : '–' }),
          make('td', { class: 'number', text: s.rays ? count(s.rays) : '–' }),
        ),
      ),
    ),
  );
}
