import{i as o}from"./chunk-4K6TUS7W.js";var r=o([]);export{r as a};
