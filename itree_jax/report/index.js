// Sorts and filters the scenes of an index by what their cards say (data-order, -scene, -score, -count, -time, -kinds).
'use strict';
(() => {
  const bar = document.querySelector('.filters'), cards = document.querySelector('.cards');
  const [sort, show, find] = ['sort', 'show', 'find'].map(name => bar.querySelector(`[name=${name}]`));
  function arrange() {
    const all = [...cards.children], key = sort.value;
    all.sort((a, b) => a.dataset[key] - b.dataset[key] || a.dataset.order - b.dataset.order);
    let left = 0;
    for (const card of all) {
      const kinds = card.dataset.kinds.split(' '), number = card.dataset.scene;
      card.hidden = (show.value && !kinds.includes(show.value)) || !number.includes(find.value.trim().replace(/^0+(?=\d)/, ''));
      left += !card.hidden;
    }
    cards.append(...all);
    bar.querySelector('output').textContent = left === all.length ? `${left} scenes` : `${left} of ${all.length} scenes`;
  }
  for (const control of [sort, show, find]) control.addEventListener('input', arrange);
  bar.hidden = false;
})();
