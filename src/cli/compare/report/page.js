// SPDX-License-Identifier: MIT
// The text around images and tables, and the start of the page.

// --- Page sections --------------------------------------------------------------------------------------------------------------

async function copy() {
  let done = false;
  try {
    await navigator.clipboard.writeText(data.command);
    done = true;
  } catch {
    const range = document.createRange(); // select it, so that the reader can
    range.selectNodeContents(by('command'));
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    done = document.execCommand('copy');
  }
  by('copied').textContent = done ? 'Copied' : 'Selected: copy it with the keyboard';
  by('copy').textContent = done ? 'Copied' : 'Selected';
  setTimeout(() => {
    by('copy').textContent = 'Copy';
  }, 2000);
}

function made() {
  by('command').textContent = data.command;
  by('copy').addEventListener('click', copy);
  const view = views[0],
    rows = [
      ['Image', `${size.width} × ${size.height}`],
      ['Material', data.material],
      ['Settings', data.settings],
      ['Exposure', data.display ? null : `${number(view.exposure, 6)}, the same for all`],
      ['Relative errors', `ignore light below ${number(view.floor)} (floor)`],
      ['Viewing', `${number(view.ppd)} pixels per degree`],
      ['Device', data.device && `${data.device}, ${data.threads} threads`],
      [
        'HDR-FLIP',
        view.hdr_exposures &&
          `${view.hdr_exposures.count} exposures from ${sign(view.hdr_exposures.start.toFixed(1))} to ` +
            `${sign(view.hdr_exposures.stop.toFixed(1))} stops`,
      ],
      ['Program', `pellucid ${data.version}`],
    ];
  by('settings').replaceChildren(...rows.filter(([, v]) => v).flatMap(([k, v]) => [make('dt', { text: k }), make('dd', { text: v })]));
  const roles = { reference: 'Reference', truth: 'Second reference', method: 'Method' };
  const cards = pictures.filter((p) => p.cite);
  by('credits').hidden = by('nav-credits').hidden = !cards.length;
  by('cards').replaceChildren(
    ...cards.map((p) =>
      make(
        'article',
        { class: 'card' },
        make('h3', { text: p.name }),
        make('p', { class: 'role', text: roles[p.role] }),
        make('p', { text: p.title }),
        make('p', { text: p.cite }),
        make('p', { class: 'small', text: `Limits: ${p.limits}` }),
        p.knobs ? make('p', { class: 'knobs', text: p.knobs }) : null,
        p.settings ? make('p', { class: 'knobs', text: `with ${p.settings}` }) : null,
      ),
    ),
  );
  by('footer').textContent =
    `Made by pellucid ${data.version}. This file is self-contained; nothing is fetched. ` +
    'SSIM: Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004. FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, ' +
    'Fairchild, HPG 2020; HDR-FLIP: Andersson, Nilsson, Shirley, Akenine-Möller, EGSR 2021. ' +
    'Colours: magma by Smith and van der Walt; blue to red by Moreland, ISVC 2009.';
}

function head() {
  const facts = [`${size.width} × ${size.height} pixels`];
  if (data.translucent_pixels) facts.push(`${count(data.translucent_pixels)} show translucent material`);
  if (data.material) facts.push(data.material);
  if (reference.seconds) facts.push(`against ${references.map((r) => r.name).join(' and ')}`);
  by('title').textContent = data.kind === 'scene' ? data.title : `${data.title} against ${reference.name}`;
  by('facts').replaceChildren(...facts.map((f) => make('span', { text: f })));
  by('warnings').replaceChildren(...data.warnings.map((w) => make('p', { class: 'note', text: w })));
  summary();
}

function theme() {
  const button = by('theme'),
    dark = matchMedia('(prefers-color-scheme: dark)'),
    store = 'pellucid-theme';
  let chosen = null;
  try {
    chosen = localStorage.getItem(store);
  } catch {
    /* the browser may refuse storage for local files */
  }
  const now = () => chosen || (dark.matches ? 'dark' : 'light');
  const show = () => {
    if (chosen) document.documentElement.dataset.theme = chosen;
    button.textContent = now() === 'dark' ? 'Light' : 'Dark';
    button.setAttribute('aria-label', `${now() === 'dark' ? 'Light' : 'Dark'} colours`);
  };
  button.addEventListener('click', () => {
    chosen = now() === 'dark' ? 'light' : 'dark';
    try {
      localStorage.setItem(store, chosen);
    } catch {
      /* as above */
    }
    show();
  });
  dark.addEventListener('change', show);
  show();
}

theme();
head();
controls();
numbers();
time();
made();
by('same').addEventListener('change', time);
ranges();
describe();
new ResizeObserver(resize).observe(stage.parentElement);
window.addEventListener('resize', resize);
resize();
setWipe(0.5);
refresh();
