// SPDX-License-Identifier: MIT
// site.js - search over the pages (search.js holds their text), the theme, and the list of pages on narrow screens.
'use strict';

const up = document.documentElement.dataset.up;
const field = document.getElementById('search'), found = document.getElementById('found');
const SHOWN = 20, AROUND = 70;

// How well a page answers all words: 0 where one is missing. Titles count most, then headings, then how often the text has it.
function score(page, words) {
  let sum = 0;
  for (const word of words) {
    const inTitle = page.lower.title.includes(word) ? 40 : 0;
    const inHeadings = page.lower.headings.filter(h => h.includes(word)).length * 8;
    const inText = Math.min(page.lower.text.split(word).length - 1, 10);
    if (!(inTitle + inHeadings + inText)) return 0;
    sum += inTitle + inHeadings + inText;
  }
  return sum;
}

// The text around the first word, with the words marked: elements, never markup.
function excerpt(page, words) {
  const at = Math.max(page.lower.text.indexOf(words[0]), 0), start = Math.max(at - AROUND, 0);
  const text = page.text.slice(start, at + 2 * AROUND), lower = text.toLowerCase();
  const line = document.createElement('small');
  let from = 0;
  for (;;) {
    const next = words.map(w => [lower.indexOf(w, from), w.length]).filter(([i]) => i >= 0).sort((a, b) => a[0] - b[0])[0];
    if (!next) break;
    const mark = document.createElement('mark');
    mark.textContent = text.slice(next[0], next[0] + next[1]);
    line.append(text.slice(from, next[0]), mark);
    from = next[0] + next[1];
  }
  line.append(text.slice(from));
  return line;
}

function search() {
  const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
  found.replaceChildren();
  found.hidden = !words.length;
  if (!words.length) return;
  for (const page of PAGES)
    page.lower ??= { title: page.title.toLowerCase(), text: page.text.toLowerCase(), headings: page.headings.map(h => h.toLowerCase()) };
  const hits = PAGES.map(page => [score(page, words), page]).filter(([s]) => s > 0).sort((a, b) => b[0] - a[0]).slice(0, SHOWN);
  for (const [, page] of hits) {
    const item = document.createElement('li'), link = document.createElement('a');
    link.href = up + page.to;
    link.append(page.title, excerpt(page, words));
    item.append(link);
    found.append(item);
  }
  if (!hits.length) found.append(Object.assign(document.createElement('li'), { textContent: 'No page has all of these words.' }));
}

field.addEventListener('input', search);
field.addEventListener('keydown', event => {
  if (event.key === 'Enter') found.querySelector('a')?.click();
  if (event.key === 'Escape') { field.value = ''; search(); }
});
document.addEventListener('keydown', event => {
  if (event.key === '/' && document.activeElement !== field) { event.preventDefault(); field.focus(); }
});

document.getElementById('theme').addEventListener('click', () => {
  const root = document.documentElement, dark = getComputedStyle(root).colorScheme === 'dark';
  root.dataset.theme = dark ? 'light' : 'dark';
  localStorage.setItem('theme', root.dataset.theme);
});

const menu = document.getElementById('menu'), opener = document.getElementById('open');
opener.addEventListener('click', () => opener.setAttribute('aria-expanded', String(menu.classList.toggle('shown'))));
const here = menu.querySelector('[aria-current]');
if (here) menu.scrollTop = here.offsetTop - menu.clientHeight / 2;

// index.html?search=WORDS
field.value = new URLSearchParams(location.search).get('search') ?? '';
search();
