// SPDX-License-Identifier: MIT
// site.js - search over the pages (search.js holds their text), the theme, and the list of pages on narrow screens.
'use strict';

const up = document.documentElement.dataset.up;
const field = document.getElementById('search'), found = document.getElementById('found');
const SHOWN = 20, AROUND = 70;

const TOKEN = /--?[a-z][\w-]*|\w[\w.-]*/g;

// Words of a text with how often they occur: "screen-space" is one, and so are its parts.
function tokens(text) {
  const counts = new Map();
  const add = word => counts.set(word, (counts.get(word) ?? 0) + 1);
  for (const [token] of text.matchAll(TOKEN)) {
    const whole = token.replace(/[.-]+$/, '');
    const parts = whole.split(/[^a-z0-9]+/).filter(Boolean);
    add(whole);
    if (parts.length > 1 || parts[0] !== whole) parts.forEach(add);
  }
  return counts;
}

// [how often the word stands there, how often a longer one begins with it].
function occurrences(counts, word) {
  let longer = 0;
  for (const [token, n] of counts) if (token !== word && token.startsWith(word)) longer += n;
  return [counts.get(word) ?? 0, longer];
}

// How well a page answers all words, 0 where one is missing, and the place in it: a name that it declares or a heading. The title counts
// most, then what the page declares, then headings, then how often the text has the word; a whole word more than the beginning of one, and
// that more than a piece.
function score(page, words) {
  const { title, headings, names, text, lower } = page.words;
  let sum = 0, place = '', best = 0;
  for (const word of words) {
    const [inTitle, startsTitle] = occurrences(title, word), [inText, startsText] = occurrences(text, word);
    const name = names.find(n => n.name === word) ?? names.find(n => n.name.startsWith(word));
    let inHeadings = 0;
    for (const h of headings) {
      const [whole, starts] = occurrences(h.words, word), points = whole ? 40 : starts ? 15 : 0;
      inHeadings = Math.max(inHeadings, points);
    }
    const points = (inTitle ? 120 : startsTitle ? 50 : 0) + (name ? name.name === word ? 100 : 30 : 0) + inHeadings
      + 2 * Math.min(inText, 10) + Math.min(startsText, 10) / 2 || (lower.includes(word) ? 1 : 0);
    if (!points) return [0, ''];
    sum += points;
    if (name && name.name === word && best < 2) [best, place] = [2, name.id];
  }
  if (words.length > 1 && words.every(w => title.has(w))) sum += 100;
  const heading = headings.find((h, i) => i > 0 && words.every(w => h.words.has(w)));
  if (heading) {
    sum += 20;
    if (best < 2) place = heading.id;
  }
  return [sum * page.weight, place];
}

// The text around the first word, with the words marked: elements, never markup.
function excerpt(page, words) {
  const at = Math.max(page.words.lower.indexOf(words[0]), 0), start = Math.max(at - AROUND, 0);
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
    page.words ??= {
      title: tokens(page.title.toLowerCase()),
      headings: page.headings.map(([id, h]) => ({ id, words: tokens(h.toLowerCase()) })),
      names: page.names.map(name => ({ id: name.startsWith('-') ? '' : name, name: name.toLowerCase() })),
      text: tokens(page.text.toLowerCase()),
      lower: page.text.toLowerCase(),
    };
  const hits = PAGES.map(page => [...score(page, words), page]).filter(([s]) => s > 0).sort((a, b) => b[0] - a[0]).slice(0, SHOWN);
  for (const [, place, page] of hits) {
    const item = document.createElement('li'), link = document.createElement('a');
    link.href = up + page.to + (place ? '#' + place : '');
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
